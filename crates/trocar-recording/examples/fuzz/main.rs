//! Reads damaged recordings of every format: `./fuzz SECONDS [--seed N] [--only NAME] [--folder
//! FOLDER]`, or `./fuzz FILE...` to read such files again.
//!
//! Each input is a sample file with some changes, all drawn from the seed and the number of the
//! input. Reading it may give an error. It must not panic, take longer than [`LONGEST`], hold more
//! memory than [`allowance`] or end the process. An input that does is kept in FOLDER
//! (`target/fuzz`), its path and seed are printed, and the exit code is 1.
//!
//! The process that reads is a child of this one, which finds out when it is killed, for example by
//! a stack overflow.

mod mutate;
mod reading;
mod samples;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use mutate::{Random, mutate};
use reading::Finding;
use samples::{Sample, samples};

#[global_allocator]
static MEMORY: peak_alloc::PeakAlloc = peak_alloc::PeakAlloc;

/// Most processor time for one input. The longest without a defect is some tenths of a second.
const LONGEST: Duration = Duration::from_secs(5);

/// Most memory for an input of `bytes` bytes: the buffers of the readers (text and MATLAB pieces of
/// some MB for each thread, 32 MB of decoded numbers of a Parquet file), and what a file of that
/// length may hold. Compression and run lengths make more of a byte than 64 bytes of numbers, but
/// not of the samples, whose rows are a few hundred.
fn allowance(bytes: usize) -> usize {
    (64 << 20) + 64 * bytes
}

/// Values of the command line.
struct Options {
    seconds: f64,
    seed: u64,
    only: String,
    folder: PathBuf,
    files: Vec<PathBuf>,
}

impl Options {
    fn parse(mut words: impl Iterator<Item = String>) -> Result<Self, String> {
        let folder = PathBuf::from("target/fuzz");
        let mut options =
            Self { seconds: 0.0, seed: 1, only: String::new(), folder, files: Vec::new() };
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or(format!("{word} needs a value"));
            match word.as_str() {
                "--seed" => {
                    options.seed = value()?.parse().map_err(|_| "--seed needs a whole number")?
                }
                "--only" => options.only = value()?,
                "--folder" => options.folder = value()?.into(),
                number if number.parse::<f64>().is_ok() => {
                    options.seconds = number.parse().unwrap_or(0.0)
                }
                file => options.files.push(file.into()),
            }
        }
        match options.seconds > 0.0 || !options.files.is_empty() {
            true => Ok(options),
            false => Err("expected SECONDS or FILE...".to_owned()),
        }
    }
}

/// Set in the environment of the process that reads.
const CHILD: &str = "TROCAR_FUZZ_CHILD";

fn main() -> ExitCode {
    let options = match Options::parse(std::env::args().skip(1)) {
        Ok(options) => options,
        Err(problem) => {
            eprintln!("{problem}");
            return ExitCode::from(2);
        }
    };
    if std::env::var_os(CHILD).is_none() {
        return supervise(&options.folder);
    }
    reading::silence_panics();
    let done = if options.files.is_empty() { fuzz(&options) } else { replay(&options.files) };
    if done { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs this program again as the child, and reports how it ended if it did not end by itself.
fn supervise(folder: &Path) -> ExitCode {
    let program = std::env::current_exe().expect("this program has a path");
    let status = Command::new(program).args(std::env::args().skip(1)).env(CHILD, "1").status();
    let status = status.expect("this program can be started again");
    if let Some(code @ 0..=1) = status.code() {
        return ExitCode::from(code as u8);
    }
    let kept = folder.join("killed");
    _ = std::fs::remove_dir_all(&kept);
    _ = std::fs::rename(current(folder), &kept);
    println!("FAILED: reading ended the process ({status}); its input: {}", kept.display());
    ExitCode::FAILURE
}

/// The folder of the input that is being read.
fn current(folder: &Path) -> PathBuf {
    folder.join("current")
}

/// Reads changed samples in turn until the time is over or one fails.
fn fuzz(options: &Options) -> bool {
    let samples = samples()
        .into_iter()
        .filter(|sample| sample.name.contains(&options.only))
        .collect::<Vec<_>>();
    assert!(!samples.is_empty(), "no sample is named {}", options.only);
    std::fs::create_dir_all(&options.folder).expect("the folder can be made");
    let watch = Watch::start();
    let start = Instant::now();
    let mut slowest = (Duration::ZERO, String::new());
    let mut most = (0, String::new());
    let (mut count, mut read) = (0, 0);
    while start.elapsed().as_secs_f64() < options.seconds {
        let input = input(&samples, options.seed, count);
        let path = input.write(&current(&options.folder));
        let found =
            watch.over(|| reading::examine(&path, &mut Random::new(options.seed, count, 1)));
        let label = format!("{} number {count}", input.name);
        if let Some(problem) = problem(&found, input.len()) {
            return keep(options, &label, &input, &problem);
        }
        slowest = slowest.max((found.time, label.clone()));
        most = most.max((found.memory, label));
        count += 1;
        read += u64::from(found.is_read);
    }
    println!(
        "{count} inputs from {} samples, {read} of them readable, seed {}",
        samples.len(),
        options.seed
    );
    println!("longest {:.3} s ({})", slowest.0.as_secs_f64(), slowest.1);
    println!("most memory {:.1} MB ({})", most.0 as f64 / 1e6, most.1);
    true
}

/// The input of a number: a sample, changed.
fn input(samples: &[Sample], seed: u64, number: u64) -> Sample {
    let mut random = Random::new(seed, number, 0);
    let at = (number % samples.len() as u64) as usize;
    let mut input = samples[at].clone();
    mutate(&mut input, &samples[random.below(samples.len())], &mut random);
    input
}

/// What is wrong with how an input of `bytes` bytes was read.
fn problem(found: &Finding, bytes: usize) -> Option<String> {
    if let Some(panic) = &found.panic {
        return Some(format!("panic: {panic}"));
    }
    if found.time > LONGEST {
        return Some(format!("{:.1} s", found.time.as_secs_f64()));
    }
    let allowed = allowance(bytes);
    (found.memory > allowed)
        .then(|| format!("{} bytes of memory for {bytes} of file, {allowed} allowed", found.memory))
}

/// Keeps an input that fails, and says where.
fn keep(options: &Options, label: &str, input: &Sample, problem: &str) -> bool {
    let folder = options.folder.join(label.replace([' ', '/'], "_"));
    let path = input.write(&folder);
    println!("FAILED: {label}, seed {}: {problem}\nkept as {}", options.seed, path.display());
    false
}

/// Reads files that failed before.
fn replay(files: &[PathBuf]) -> bool {
    let mut fine = true;
    for path in files {
        let found = reading::examine(path, &mut Random::new(1, 0, 1));
        let bytes = samples::bytes_of(path);
        let result = problem(&found, bytes)
            .map_or("fine".to_owned(), |problem| format!("FAILED: {problem}"));
        println!(
            "{}: {:.3} s, {:.1} MB, {result}",
            path.display(),
            found.time.as_secs_f64(),
            found.memory as f64 / 1e6
        );
        fine &= !result.starts_with("FAILED");
    }
    fine
}

/// Longest time for one input, on a busy machine.
const ENDLESS: Duration = Duration::from_secs(120);

/// Ends the process when one input takes far too long, so that a loop without an end is found.
struct Watch(Arc<AtomicU64>);

impl Watch {
    fn start() -> Self {
        let done = Arc::new(AtomicU64::new(0));
        let watched = done.clone();
        std::thread::spawn(move || {
            let mut before = u64::MAX;
            while watched.load(Ordering::Relaxed) != before {
                before = watched.load(Ordering::Relaxed);
                std::thread::sleep(ENDLESS);
            }
            println!("an input takes longer than {:.0} s", ENDLESS.as_secs_f64());
            std::process::abort();
        });
        Self(done)
    }

    fn over<T>(&self, work: impl FnOnce() -> T) -> T {
        let result = work();
        self.0.fetch_add(1, Ordering::Relaxed);
        result
    }
}
