//! What simulation of a long motion keeps in memory.
#![cfg(target_os = "linux")]

use std::io::{Read, Write as _};

use trocar::recording::Choice;
use trocar::simulate::{Positions, SimulateOptions, fields, simulate};
use trocar::table::TableWriter;
use trocar_model::{Element, ElementParams, Trocar};

/// An endless supply of rows, generated while they are read.
struct Rows {
    next: u64,
    count: u64,
    pending: Vec<u8>,
}

impl Read for Rows {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        while self.pending.len() < buffer.len() && self.next < self.count {
            writeln!(self.pending, "{},{:.6}", self.next, 0.1 * (self.next as f64 * 1e-3).sin())?;
            self.next += 1;
        }
        let length = self.pending.len().min(buffer.len());
        buffer[..length].copy_from_slice(&self.pending[..length]);
        self.pending.drain(..length);
        Ok(length)
    }
}

/// Memory of this process in kB.
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

#[test]
fn memory_does_not_grow_with_the_motion() {
    const ROWS: u64 = 2_000_000;
    let trocar =
        Trocar::of_seal(Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap());
    let input = Rows { next: 0, count: ROWS, pending: Vec::new() };
    let mut output = TableWriter::create("/dev/null", &fields(&trocar)).unwrap();
    let before = resident();
    let (mut peak, mut reached) = (before, 0);
    let progress = |_, rows| {
        peak = peak.max(resident());
        reached = rows;
    };
    let motion =
        Positions::from_text("made", input, &Choice::columns("time_ms,position_m")).unwrap();
    let simulated =
        simulate(motion, &trocar, &SimulateOptions::default(), &mut output, progress).unwrap();
    assert_eq!(simulated.rows, ROWS);
    assert!(simulated.lowest <= simulated.highest);
    // The text alone has over 30 MB.
    assert!(reached > ROWS / 2, "{reached}");
    assert!(peak - before < 10_000, "{before} to {peak} kB");
}
