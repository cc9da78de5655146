//! Streams that may be compressed or in UTF-16: gzip, zstd, xz and byte order marks are detected by
//! their first bytes.

use std::fs::File;
use std::io::{self, Cursor, Read};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::utf16::{BIG_ENDIAN, Decoder, LITTLE_ENDIAN};

/// First bytes of gzip members, of zstd frames and of xz streams.
const GZIP: [u8; 2] = [0x1f, 0x8b];
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
const XZ: [u8; 6] = *b"\xfd7zXZ\0";

/// Most memory of the xz decoder, bytes: `xz -9` needs 65 MiB, and a header may ask for 4 GiB.
#[cfg(feature = "xz")]
const XZ_MEMORY: u64 = 100 << 20;

/// Bytes read at a time from a compressed stream.
#[cfg(feature = "gzip")]
const PIECE: usize = 1 << 16;

/// The text in a file or from standard input.
pub struct TextInput {
    /// The text in UTF-8.
    pub text: Box<dyn Read + Send>,
    /// Size of the file, compressed or not, and number of bytes read; `None` for a stream.
    pub file: Option<(u64, Arc<AtomicU64>)>,
}

impl TextInput {
    /// Opens the file at `path`, or standard input for `-`.
    ///
    /// # Errors
    /// The error of the operating system, or that this build lacks the file's compression.
    pub fn open(path: &Path) -> io::Result<Self> {
        if path == Path::new("-") {
            return Ok(Self { text: decoded(decompressed(Box::new(io::stdin()))?)?, file: None });
        }
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        if metadata.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let read = Arc::new(AtomicU64::new(0));
        let counted = Counted { inner: file, read: read.clone() };
        let text = decoded(decompressed(Box::new(counted))?)?;
        Ok(Self { text, file: metadata.is_file().then_some((metadata.len(), read)) })
    }
}

/// A stream whose head can be read a second time, with another choice of columns. Clones share it.
#[derive(Clone)]
pub struct Head(Arc<Mutex<Kept>>);

struct Kept {
    input: Box<dyn Read + Send>,
    /// Bytes read so far, and how many of them have been passed on since the last start.
    bytes: Vec<u8>,
    passed: usize,
    /// Whether bytes are still kept.
    keeps: bool,
}

impl Head {
    /// Keeps what is read of `input`.
    pub fn new(input: Box<dyn Read + Send>) -> Self {
        Self(Arc::new(Mutex::new(Kept { input, bytes: Vec::new(), passed: 0, keeps: true })))
    }

    /// Starts again at the first byte.
    pub fn rewind(&self) {
        self.kept().passed = 0;
    }

    /// Keeps no further bytes.
    pub fn forget(&self) {
        self.kept().keeps = false;
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Read for Head {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let kept = &mut *self.kept();
        if kept.passed < kept.bytes.len() {
            let read = (&kept.bytes[kept.passed..]).read(bytes)?;
            kept.passed += read;
            return Ok(read);
        }
        let read = kept.input.read(bytes)?;
        if kept.keeps {
            kept.bytes.extend_from_slice(&bytes[..read]);
            kept.passed += read;
        } else {
            (kept.bytes, kept.passed) = (Vec::new(), 0);
        }
        Ok(read)
    }
}

/// Counts the bytes read.
struct Counted<R> {
    inner: R,
    read: Arc<AtomicU64>,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(bytes)?;
        self.read.fetch_add(read as u64, Ordering::Relaxed);
        Ok(read)
    }
}

/// The text of a stream that may be compressed; several consecutive gzip members or zstd frames
/// form one text.
///
/// # Errors
/// The error of the operating system for the first bytes, or that this build lacks the
/// stream's compression.
fn decompressed(mut input: Box<dyn Read + Send>) -> io::Result<Box<dyn Read + Send>> {
    let mut head = Vec::with_capacity(XZ.len());
    (&mut input).take(XZ.len() as u64).read_to_end(&mut head)?;
    let whole = Cursor::new(head.clone()).chain(input);
    let format = match () {
        () if head.starts_with(&GZIP) => "gzip",
        () if head.starts_with(&ZSTD) => "zstd",
        () if head.starts_with(&XZ) => "xz",
        () => return Ok(Box::new(whole)),
    };
    Ok(Box::new(Told { text: decoder(whole, format)?, format, bytes: 0 }))
}

#[cfg_attr(
    not(any(feature = "gzip", feature = "zstd", feature = "xz")),
    allow(unused_variables, reason = "nothing is decoded")
)]
fn decoder(input: impl Read + Send + 'static, format: &str) -> io::Result<Box<dyn Read + Send>> {
    match format {
        #[cfg(feature = "gzip")]
        "gzip" => {
            let input = io::BufReader::with_capacity(PIECE, input);
            Ok(Box::new(flate2::bufread::MultiGzDecoder::new(input)))
        }
        #[cfg(feature = "zstd")]
        "zstd" => Ok(Box::new(zstd::Decoder::new(input)?)),
        #[cfg(feature = "xz")]
        "xz" => {
            use liblzma::stream::{CONCATENATED, Stream};
            let stream = Stream::new_stream_decoder(XZ_MEMORY, CONCATENATED)?;
            Ok(Box::new(liblzma::read::XzDecoder::new_stream(input, stream)))
        }
        name => {
            let text = format!(
                "compressed with {name}, and this build has no feature {name}; build with --features {name} or decompress it"
            );
            Err(io::Error::new(io::ErrorKind::Unsupported, text))
        }
    }
}

/// The same text in UTF-8 if a byte order mark says that it is in UTF-16.
fn decoded(mut input: Box<dyn Read + Send>) -> io::Result<Box<dyn Read + Send>> {
    let mut head = Vec::with_capacity(LITTLE_ENDIAN.len());
    (&mut input).take(LITTLE_ENDIAN.len() as u64).read_to_end(&mut head)?;
    let is_little_endian = head == LITTLE_ENDIAN;
    let is_utf16 = is_little_endian || head == BIG_ENDIAN;
    let whole = Cursor::new(head).chain(input);
    Ok(if is_utf16 { Box::new(Decoder::new(whole, is_little_endian)) } else { Box::new(whole) })
}

/// A decoder whose errors state the format and the position reached.
struct Told {
    text: Box<dyn Read + Send>,
    format: &'static str,
    bytes: u64,
}

impl Read for Told {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self.text.read(bytes) {
            Ok(read) => {
                self.bytes += read as u64;
                Ok(read)
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Err(error),
            Err(error) => Err(self.fault(&error)),
        }
    }
}

impl Told {
    fn fault(&self, error: &io::Error) -> io::Error {
        let (format, bytes) = (self.format, self.bytes);
        let text = match error.kind() {
            io::ErrorKind::UnexpectedEof => {
                format!(
                    "the {format} stream ends early, after {bytes} bytes of text; was it cut off while it was copied?"
                )
            }
            _ => format!("the {format} stream is damaged after {bytes} bytes of text ({error})"),
        };
        io::Error::new(error.kind(), text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::GzEncoder;
    use std::io::Write;

    const TEXT: &[u8] = b"time_s,position_mm,force_n\n0.0,0.0,0.0\n0.001,0.1,0.2\n";

    fn gzip(text: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(text).unwrap();
        encoder.finish().unwrap()
    }

    fn read(bytes: Vec<u8>) -> io::Result<Vec<u8>> {
        let mut text = Vec::new();
        decompressed(Box::new(Cursor::new(bytes)))?.read_to_end(&mut text)?;
        Ok(text)
    }

    #[test]
    fn plain_text_stays_as_it_is_however_short() {
        for length in 0..TEXT.len() {
            assert_eq!(read(TEXT[..length].to_vec()).unwrap(), &TEXT[..length]);
        }
    }

    #[test]
    fn members_after_each_other_are_one_text() {
        let mut both = gzip(&TEXT[..30]);
        both.extend(gzip(&TEXT[30..]));
        assert_eq!(read(both).unwrap(), TEXT);
    }

    #[cfg(feature = "xz")]
    fn xz(text: &[u8]) -> Vec<u8> {
        let mut stream = Vec::new();
        liblzma::read::XzEncoder::new(text, 6).read_to_end(&mut stream).unwrap();
        stream
    }

    #[cfg(feature = "xz")]
    #[test]
    fn xz_streams_after_each_other_are_one_text() {
        assert_eq!(read([xz(&TEXT[..30]), xz(&TEXT[30..])].concat()).unwrap(), TEXT);
    }

    #[cfg(feature = "zstd")]
    #[test]
    fn zstd_frames_after_each_other_are_one_text() {
        let mut both = zstd::encode_all(&TEXT[..30], 3).unwrap();
        both.extend(zstd::encode_all(&TEXT[30..], 3).unwrap());
        assert_eq!(read(both).unwrap(), TEXT);
    }

    #[test]
    fn a_stream_that_ends_early_says_so_wherever_it_ends() {
        let mut streams = vec![gzip(TEXT)];
        #[cfg(feature = "xz")]
        streams.push(xz(TEXT));
        #[cfg(feature = "zstd")]
        streams.push(zstd::encode_all(TEXT, 3).unwrap());
        for stream in streams {
            for length in XZ.len()..stream.len() {
                let error = read(stream[..length].to_vec()).unwrap_err().to_string();
                assert!(error.contains("ends early"), "{length}: {error}");
            }
        }
    }

    #[test]
    fn a_changed_byte_is_no_other_text() {
        let stream = gzip(TEXT);
        for at in 10..stream.len() {
            let mut changed = stream.clone();
            changed[at] ^= 0x55;
            assert!(read(changed).is_err(), "byte {at}");
        }
    }
}
