//! Chunks of messages, decoded on all cores, a few at a time: memory is bounded by a few chunks per
//! core, and the rows that wait for overlapping ones ([`super::ordered`]).

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use trocar_tables::ros::{Block, Description, Extractor, Topic};

use super::bag::{Log, Messages};
use super::ordered::Blocks;
use crate::RecordingError;

/// Bytes of messages without chunks that are decoded at a time.
pub(super) const RUN: u64 = 1 << 20;

/// Chunks per core, and total number of bytes, that are decoded at the same time.
const PER_CORE: usize = 4;
const MOST_AT_ONCE: u64 = 1 << 28;

/// An open file, of `size` bytes.
pub(super) struct Input {
    pub(super) file: File,
    pub(super) size: u64,
}

impl Input {
    pub(super) fn open(path: &Path) -> Result<Self, RecordingError> {
        let file = File::open(path).map_err(RecordingError::cannot_open(path))?;
        let size = file.metadata().map_err(RecordingError::cannot_open(path))?.len();
        Ok(Self { file, size })
    }
}

/// A part of the file that holds messages. ROS 1 states whether it is a chunk, and of what size, where it begins.
#[derive(Debug, Clone)]
#[cfg_attr(not(feature = "mcap"), allow(dead_code))]
pub(super) struct Piece {
    pub(super) at: u64,
    /// Its bytes in the file; `None` for a chunk that states them where it begins.
    pub(super) length: Option<u64>,
    /// Bytes of its records, if they are known.
    pub(super) decompressed: u64,
    /// First log time, ns.
    pub(super) start: u64,
    /// Its channels; `None` if unknown.
    pub(super) channels: Option<BTreeSet<u32>>,
    pub(super) is_chunk: bool,
}

impl Piece {
    /// A part without messages yet.
    pub(super) fn empty(at: u64, length: Option<u64>, is_chunk: bool) -> Self {
        let channels = Some(BTreeSet::new());
        Self { at, length, decompressed: 0, start: u64::MAX, channels, is_chunk }
    }

    /// Adds a message.
    pub(super) fn add(&mut self, message: Message) {
        self.start = self.start.min(message.log);
        self.channels.get_or_insert_default().insert(message.channel);
    }

    fn may_hold(&self, channels: &BTreeSet<u32>) -> bool {
        self.channels.as_ref().is_none_or(|held| !held.is_disjoint(channels))
    }
}

/// A message of a channel; times in ns.
#[derive(Clone, Copy)]
pub(super) struct Message<'a> {
    pub(super) channel: u32,
    pub(super) log: u64,
    pub(super) publish: u64,
    pub(super) payload: &'a [u8],
}

/// Memory for one piece, reused for the next.
#[derive(Default)]
pub(super) struct Buffers {
    pub(super) stored: Vec<u8>,
    pub(super) decompressed: Vec<u8>,
}

/// A format of chunks.
pub(super) trait Chunked: Send + 'static {
    const NAME: &'static str;

    /// Bytes that a piece will take in memory, as far as they are known.
    fn size(input: &Input, piece: &Piece) -> u64;

    /// The records of a piece; `None` when it is damaged.
    fn load<'a>(input: &Input, piece: &Piece, buffers: &'a mut Buffers) -> Option<&'a [u8]>;

    /// Passes on the messages among records.
    fn messages(records: &[u8], take: &mut dyn FnMut(Message));

    /// The warning about damaged pieces, of `bytes` in all.
    fn damage(pieces: u64, bytes: u64) -> Option<String>;
}

/// Content of the index, or result of a scan of the file.
#[derive(Debug, Default)]
pub(super) struct Contents {
    /// Messages of each channel.
    pub(super) counts: BTreeMap<u32, u64>,
    /// First message of each channel.
    pub(super) first: BTreeMap<u32, Vec<u8>>,
    pub(super) pieces: Vec<Piece>,
    /// First log time, ns, if the file states it.
    pub(super) start: Option<u64>,
    pub(super) warnings: Vec<String>,
}

impl Contents {
    /// Counts a message found without the help of an index.
    pub(super) fn count(&mut self, message: Message) {
        *self.counts.entry(message.channel).or_default() += 1;
        self.first.entry(message.channel).or_insert_with(|| message.payload.to_vec());
    }

    /// Sorts the pieces by time, and finds the first message of each of `channels` for which it is
    /// unknown.
    pub(super) fn complete<F: Chunked>(
        &mut self,
        path: &Path,
        input: &Input,
        channels: impl Iterator<Item = u32>,
    ) -> Result<(), RecordingError> {
        self.pieces.sort_by_key(|piece| (piece.start, piece.at));
        self.start = self.start.or(self.pieces.first().map(|piece| piece.start));
        let (first, counts) = (&mut self.first, &self.counts);
        let mut missing: BTreeSet<u32> =
            channels.filter(|id| !first.contains_key(id) && counts.get(id) != Some(&0)).collect();
        let mut buffers = Buffers::default();
        for piece in &self.pieces {
            if !piece.may_hold(&missing) || missing.is_empty() {
                continue;
            }
            let Some(records) = F::load(input, piece, &mut buffers) else { continue };
            F::messages(records, &mut |message| {
                if missing.remove(&message.channel) {
                    first.insert(message.channel, message.payload.to_vec());
                }
            });
        }
        if !first.is_empty() {
            return Ok(());
        }
        let problem = match self.warnings.first() {
            Some(warning) => format!("holds no whole message: {warning}"),
            None => "holds no messages".into(),
        };
        Err(RecordingError::unusable(path.display(), problem))
    }

    /// Channels with messages, grouped by what their topics are.
    pub(super) fn groups<K: PartialEq>(
        &self,
        channels: impl Iterator<Item = (u32, K)>,
    ) -> Vec<(K, BTreeSet<u32>)> {
        let mut groups: Vec<(K, BTreeSet<u32>)> = Vec::new();
        for (id, topic) in channels.filter(|(id, _)| self.first.contains_key(id)) {
            match groups.iter_mut().find(|(known, _)| *known == topic) {
                Some((_, group)) => {
                    group.insert(id);
                }
                None => groups.push((topic, BTreeSet::from([id]))),
            }
        }
        groups
    }

    /// The log with these topics, each of some channels.
    pub(super) fn log<F: Chunked>(
        self,
        path: &Path,
        topics: Vec<(Description<'_>, BTreeSet<u32>)>,
    ) -> Log {
        let mut warnings = self.warnings;
        let mut channels = Vec::new();
        let mut found = Vec::new();
        for (description, group) in topics {
            let rows = group.iter().map(|id| self.counts.get(id).copied()).sum();
            let first = group.first().and_then(|id| self.first.get(id));
            let description = Description { rows, ..description };
            let (topic, problem) = Topic::new(&description, first.map(|first| &first[..]));
            found.push(topic);
            channels.push(group);
            warnings.extend(problem);
        }
        let path_of = path.to_owned();
        let pieces =
            Pieces::<F> { path: path_of, pieces: self.pieces, channels, format: PhantomData };
        Log::new(path, F::NAME, self.start, found, warnings, Box::new(pieces))
    }
}

/// The pieces of a file, and the channels of each topic.
struct Pieces<F> {
    path: PathBuf,
    pieces: Vec<Piece>,
    channels: Vec<BTreeSet<u32>>,
    format: PhantomData<F>,
}

impl<F: Chunked> Messages for Pieces<F> {
    fn blocks(
        &self,
        topic: usize,
        extractor: Extractor,
    ) -> Result<Box<dyn Blocks>, RecordingError> {
        let channels = self.channels[topic].clone();
        let pieces =
            self.pieces.iter().filter(|piece| piece.may_hold(&channels)).cloned().collect();
        Ok(Box::new(Chunks::<F> {
            path: self.path.clone(),
            channels,
            extractor,
            pieces,
            at: 0,
            decoded: Vec::new().into_iter(),
            damaged: 0,
            lost: 0,
            format: PhantomData,
        }))
    }
}

/// The pieces that contain a topic, decoded a few at a time.
struct Chunks<F> {
    path: PathBuf,
    channels: BTreeSet<u32>,
    extractor: Extractor,
    pieces: Vec<Piece>,
    at: usize,
    decoded: std::vec::IntoIter<Option<Block>>,
    damaged: u64,
    lost: u64,
    format: PhantomData<F>,
}

impl<F: Chunked> Chunks<F> {
    /// Decodes the next few pieces.
    fn decode(&mut self) -> Result<(), RecordingError> {
        let input = Input::open(&self.path)?;
        let most = PER_CORE * rayon::current_num_threads();
        let mut bytes = 0_u64;
        let few = self.pieces[self.at..].iter().take(most).take_while(|piece| {
            let with = bytes.saturating_add(F::size(&input, piece));
            // The first is taken whatever its size, or nothing would ever be read.
            let fits = bytes == 0 || with <= MOST_AT_ONCE;
            bytes = with;
            fits
        });
        let to = self.at + few.count();
        let decoded: Vec<Option<Block>> = self.pieces[self.at..to]
            .par_iter()
            .map_init(
                || (Buffers::default(), self.extractor.clone()),
                |(buffers, extractor), piece| {
                    let records = F::load(&input, piece, buffers)?;
                    Some(block::<F>(records, &self.channels, extractor))
                },
            )
            .collect();
        self.decoded = decoded.into_iter();
        Ok(())
    }
}

/// The rows of some channels among the records of a piece.
fn block<F: Chunked>(records: &[u8], channels: &BTreeSet<u32>, extractor: &mut Extractor) -> Block {
    let mut block = Block::new(extractor.width());
    F::messages(records, &mut |message| {
        if channels.contains(&message.channel) {
            extractor.add(message.log, message.publish, message.payload, &mut block);
        }
    });
    block
}

impl<F: Chunked> Blocks for Chunks<F> {
    fn next(&mut self) -> Result<Option<Block>, RecordingError> {
        while self.at < self.pieces.len() {
            let Some(decoded) = self.decoded.next() else {
                self.decode()?;
                continue;
            };
            self.at += 1;
            match decoded {
                None => {
                    self.damaged += 1;
                    self.lost += self.pieces[self.at - 1].length.unwrap_or(0);
                }
                Some(mut block) => {
                    block.settled = self.pieces.get(self.at).map(|piece| piece.start);
                    return Ok(Some(block));
                }
            }
        }
        Ok(None)
    }

    fn warnings(&self) -> Vec<String> {
        F::damage(self.damaged, self.lost).into_iter().collect()
    }
}
