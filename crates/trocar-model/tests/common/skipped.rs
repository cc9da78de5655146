//! Tests that cannot run on this machine.

use std::fs::OpenOptions;
use std::io::Write as _;

/// Prints why the present test is skipped, on standard error itself: the output of a passing test
/// is not shown. The reason is also appended to the file that `TROCAR_SKIPPED` names: `./test`
/// lists them at its end.
///
/// # Panics
///
/// If that file cannot be written: a skip must not go unnoticed.
pub(crate) fn skipped(why: &str) {
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    let why = why.trim().replace('\n', " ");
    let line = format!("skipped: {} {test}: {why}\n", env!("CARGO_PKG_NAME"));
    let _ = std::io::stderr().write_all(line.as_bytes());
    if let Some(list) = std::env::var_os("TROCAR_SKIPPED") {
        // One write a line: tests run in several threads and processes.
        let written = OpenOptions::new().create(true).append(true).open(&list);
        written.and_then(|mut list| list.write_all(line.as_bytes())).expect("TROCAR_SKIPPED");
    }
}
