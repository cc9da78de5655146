//! Diagrams of the recipe for Simulink: the ports of its block, and the block in a model.

use super::Outcome;
use super::sheet::{Align, EDGE, GREY, INK, PALE, PALE_BLUE, Pen, Point, Sheet, WHITE};

const LINE: Pen = Pen::new(INK, 1.2);

/// A block with its name and a word below it.
fn block(sheet: &mut Sheet, at: Point, size: Point, fill: &str, [name, word]: [&str; 2]) {
    sheet.rect(at, size, fill, EDGE);
    let [x, y] = [at[0] + 0.5 * size[0], at[1] + 0.5 * size[1]];
    let up = if word.is_empty() { 5.0 } else { -3.0 };
    sheet.text([x, y + up], Align::Middle, INK, name);
    sheet.text([x, y + 15.0], Align::Middle, GREY, word);
}

pub(crate) fn ports() -> Outcome<Sheet> {
    const COLUMNS: [f64; 5] = [130.0, 180.0, 130.0, 90.0, 60.0];
    const ROWS: [[&str; 5]; 5] = [
        ["Name", "Scope", "Label", "Type", "Size"],
        ["start", "Input", "start", "double", "1"],
        ["position_m", "Input", "position_m", "double", "1"],
        ["duration_s", "Parameter", "duration_s", "double", "1"],
        ["seal_block", "Output (return value)", "force_n", "double", "1"],
    ];
    let mut sheet = Sheet::new(640.0, 230.0);
    sheet.text([15.0, 26.0], Align::Start, INK, "C Caller. Function name: seal_block");
    sheet.text([15.0, 48.0], Align::Start, GREY, "Port specification");
    let mut y = 60.0;
    for (k, row) in ROWS.iter().enumerate() {
        let mut x = 15.0;
        for (width, words) in COLUMNS.iter().zip(row) {
            sheet.rect(
                [x, y],
                [*width, 26.0],
                if k == 0 { PALE_BLUE } else { WHITE },
                Pen::new(GREY, 1.0),
            );
            sheet.text([x + 8.0, y + 18.0], Align::Start, INK, words);
            x += width;
        }
        y += 26.0;
    }
    sheet.text(
        [15.0, 214.0],
        Align::Start,
        GREY,
        "Value of the parameter duration_s: 1e-3, the sample time of the Zero-Order Hold",
    );
    Ok(sheet)
}

pub(crate) fn model() -> Outcome<Sheet> {
    let mut sheet = Sheet::new(780.0, 270.0);
    block(&mut sheet, [20.0, 34.0], [110.0, 50.0], PALE, ["Constant", "0"]);
    block(&mut sheet, [176.0, 34.0], [140.0, 50.0], PALE, ["Unit Delay", "initial condition 1"]);
    block(&mut sheet, [20.0, 122.0], [110.0, 56.0], PALE, ["Plant", "position, m"]);
    block(&mut sheet, [190.0, 122.0], [112.0, 56.0], PALE, ["Zero-Order", "Hold, 1 ms"]);
    block(&mut sheet, [390.0, 30.0], [180.0, 164.0], PALE_BLUE, ["", ""]);
    sheet.text([480.0, 184.0], Align::Middle, INK, "C Caller: seal_block");
    block(&mut sheet, [670.0, 86.0], [96.0, 52.0], PALE, ["Scope", "force, N"]);
    block(&mut sheet, [602.0, 212.0], [56.0, 40.0], PALE, ["−1", ""]);
    sheet.text([398.0, 64.0], Align::Start, INK, "start");
    sheet.text([398.0, 155.0], Align::Start, INK, "position_m");
    sheet.text([562.0, 117.0], Align::End, INK, "force_n");
    for (from, to, y) in [
        (130.0, 176.0, 59.0),
        (316.0, 390.0, 59.0),
        (130.0, 190.0, 150.0),
        (302.0, 390.0, 150.0),
        (570.0, 670.0, 112.0),
    ] {
        sheet.arrow(&[[from, y], [to, y]], LINE);
    }
    sheet.arrow(&[[630.0, 112.0], [630.0, 212.0]], LINE);
    sheet.dot([630.0, 112.0], INK);
    sheet.arrow(&[[602.0, 232.0], [75.0, 232.0], [75.0, 178.0]], LINE);
    sheet.text([330.0, 226.0], Align::Middle, GREY, "force on the instrument, N");
    Ok(sheet)
}
