//! Which column of a header, or of a table, holds which quantity: by name, by unit, or as the
//! caller says.
//!
//! Doubt is an error with all that is unclear at once, and with the option that settles it.

use super::RecordingError;
use super::columns::{
    AN_ANGLE, CONVERT_ANGLE, Given, Layout, Quantity, Reading, Slot, UNIT_IN_CELL, entry, is_angle,
    is_related, listed, numbered, reading_with, unit_alone,
};

/// The names of the columns, and what else tells their meaning.
pub(crate) struct Header<'a> {
    pub(crate) file: &'a str,
    /// Place in the file, ` line 1`; empty if a table has no lines.
    pub(crate) place: &'a str,
    pub(crate) names: &'a [String],
    /// The declared units, one each, or none at all.
    pub(crate) units: &'a [String],
    /// Columns of dates with times of day.
    pub(crate) timestamps: &'a [usize],
    /// Numbers of the first rows by column, for a guess of the units; a column without numbers is
    /// empty, and all are if the rows are not known.
    pub(crate) first_rows: &'a dyn Fn() -> Vec<Vec<f64>>,
    /// The first cell of a column in these rows that is neither a number nor missing.
    pub(crate) first_text: &'a dyn Fn(usize) -> Option<Text>,
}

/// A cell without a number of its own.
pub(crate) enum Text {
    /// A number and its unit, as written.
    WithUnit(String),
    Other,
}

/// What is unclear about a quantity that is needed.
enum Doubt {
    Missing,
    /// The column is clear, its unit is not.
    Unit(usize),
    /// Several columns.
    Several(Vec<usize>),
}

/// A column as a message proposes it: quantity, index, units per SI unit.
type Proposal = (Quantity, usize, f64);

/// Proposed columns, and whether any unit among them is a guess.
struct Proposed {
    columns: Vec<Proposal>,
    guessed: bool,
}

/// What a column of times may also hold.
const OR_DATES: &str = " or as dates such as 2026-11-22T10:15:00.123";

/// Whether a column has no numbers in rows that are known.
fn has_no_numbers(rows: &[Vec<f64>], column: usize) -> bool {
    rows.iter().any(|own| !own.is_empty()) && rows.get(column).is_some_and(Vec::is_empty)
}

/// Words for a quantity that are too weak to take a column by, but good enough for a proposal.
fn weak_words(quantity: Quantity) -> &'static [&'static str] {
    match quantity {
        Quantity::Time => &[
            "zeit", "temps", "tiempo", "tempo", "ts", "clock", "date", "datetime", "ticks", "sec",
            "ms",
        ],
        Quantity::Position => &[
            "weg",
            "lage",
            "hub",
            "z",
            "y",
            "s",
            "travel",
            "stroke",
            "encoder",
            "enc",
            "disp",
            "mm",
            "posizione",
            "posicion",
            "path",
        ],
        Quantity::Force => &[
            "kraft", "fz", "fy", "fx", "loadcell", "cell", "fuerza", "forza", "effort", "reibung",
            "n",
        ],
        Quantity::Velocity => &[],
    }
}

impl Header<'_> {
    /// The layout, with the columns named explicitly in `given`.
    pub(crate) fn layout(
        &self,
        given: &[Given],
        needed: &[Quantity],
    ) -> Result<Layout, RecordingError> {
        let names = self.names;
        let mut slots = vec![None; names.len()];
        let mut notes = Vec::new();
        let mut readings: Vec<Option<Reading>> = names
            .iter()
            .enumerate()
            .map(|(k, name)| {
                // A date has the unit of the file's format, whatever its name says.
                let declared = if self.timestamps.contains(&k) { "" } else { self.unit(k) };
                reading_with(name, declared, &mut notes)
            })
            .collect();
        // An angle is no position, even if nothing else is.
        for (k, reading) in readings.iter_mut().enumerate() {
            reading.take_if(|own| own.quantity == Quantity::Position && self.is_angle(k));
        }
        for k in self.timestamps {
            // The unit of a date is known. A row may have more cells than the header.
            let own = readings.get_mut(*k).and_then(Option::as_mut);
            let own = own.filter(|own| own.quantity == Quantity::Time);
            own.into_iter().for_each(|own| own.per_si = Some(1.0));
        }
        for named in given {
            let index = named.find(names)?;
            named.check_angle(&names[index], self.unit(index))?;
            if slots[index].is_some() {
                let problem = "a column named for two quantities, expected one".to_owned();
                return Err(RecordingError::BadColumns { entry: names[index].clone(), problem });
            }
            let is_time = named.quantity == Quantity::Time && self.timestamps.contains(&index);
            let declared = reading_with(named.quantity.name(), self.unit(index), &mut notes);
            slots[index] = Some(if is_time {
                Slot::of(Quantity::Time, 1.0)
            } else {
                named.slot(readings[index].or(declared))?
            });
            readings[index] = None;
        }
        let mut doubts = Vec::new();
        let mut by_unit = false;
        for quantity in
            Quantity::ALL.into_iter().filter(|q| given.iter().all(|given| given.quantity != *q))
        {
            let needed = needed.contains(&quantity);
            match self.choose(quantity, &readings) {
                Ok((index, slot)) => {
                    if readings[index].is_some_and(|reading| !reading.exact) {
                        notes.push(format!(
                            "column '{}' taken as {}",
                            names[index],
                            quantity.name()
                        ));
                    }
                    slots[index] = Some(slot);
                }
                Err(Doubt::Missing) if needed => {
                    match self.by_unit(quantity, &readings, &slots)[..] {
                        [(index, per_si)] => {
                            let why = if self.timestamps.contains(&index) {
                                "timestamps"
                            } else {
                                "unit"
                            };
                            notes.push(format!(
                                "column '{}' taken as {}, by its {why}",
                                names[index],
                                quantity.name()
                            ));
                            slots[index] = Some(Slot::of(quantity, per_si));
                            by_unit = true;
                        }
                        [] => doubts.push((quantity, Doubt::Missing)),
                        ref several => {
                            doubts.push((
                                quantity,
                                Doubt::Several(several.iter().map(|(index, _)| *index).collect()),
                            ));
                        }
                    }
                }
                Err(doubt) if needed => doubts.push((quantity, doubt)),
                Err(Doubt::Missing) => {}
                Err(Doubt::Unit(index)) => notes.push(self.not_used(index, quantity)),
                Err(Doubt::Several(several)) => notes.push(self.not_used(several[0], quantity)),
            }
        }
        if !doubts.is_empty() {
            return Err(self.unclear(&doubts, &readings, &slots));
        }
        Ok(Layout {
            names: names.to_vec(),
            slots,
            source: "the header",
            notes,
            by_unit,
            ..Layout::default()
        })
    }

    fn is_angle(&self, column: usize) -> bool {
        is_angle(&self.names[column], self.unit(column))
    }

    /// A column of angles where a position is needed.
    fn angle(&self, doubts: &[(Quantity, Doubt)]) -> Option<usize> {
        let lacks = |(quantity, doubt): &(Quantity, Doubt)| {
            *quantity == Quantity::Position && matches!(doubt, Doubt::Missing)
        };
        doubts.iter().any(lacks).then(|| (0..self.names.len()).find(|k| self.is_angle(*k)))?
    }

    /// Declared unit of a column; empty without one.
    fn unit(&self, column: usize) -> &str {
        self.units.get(column).map_or("", String::as_str)
    }

    /// The column as `--columns` takes it: `NAME#2` is the second of one name.
    fn option(&self, index: usize) -> String {
        numbered(self.names, index)
    }

    fn not_used(&self, index: usize, quantity: Quantity) -> String {
        let (name, quantity) = (&self.names[index], quantity.name());
        format!("column '{name}' not used: unclear whether it is {quantity} and in which unit")
    }

    /// The one column whose name denotes the quantity: exactly, or else among other words.
    fn choose(
        &self,
        quantity: Quantity,
        readings: &[Option<Reading>],
    ) -> Result<(usize, Slot), Doubt> {
        let of = |exact: bool| {
            let matching = readings.iter().enumerate().filter(move |(_, reading)| {
                reading
                    .is_some_and(|reading| reading.quantity == quantity && reading.exact == exact)
            });
            matching.map(|(index, _)| index).collect::<Vec<_>>()
        };
        let candidates =
            Some(of(true)).filter(|exact| !exact.is_empty()).unwrap_or_else(|| of(false));
        match candidates[..] {
            [] => Err(Doubt::Missing),
            [index] => match readings[index].and_then(|reading| reading.per_si) {
                Some(per_si) => Ok((index, Slot::of(quantity, per_si))),
                None => Err(Doubt::Unit(index)),
            },
            _ => Err(Doubt::Several(candidates)),
        }
    }

    /// Columns, with their units per SI unit, whose names denote no quantity but have a unit of
    /// this one.
    fn by_unit(
        &self,
        quantity: Quantity,
        readings: &[Option<Reading>],
        slots: &[Option<Slot>],
    ) -> Vec<(usize, f64)> {
        let free = (0..self.names.len()).filter(|k| readings[*k].is_none() && slots[*k].is_none());
        let own = |k: usize| match self.timestamps.contains(&k) {
            true => Some((Quantity::Time, 1.0)).filter(|_| quantity == Quantity::Time),
            false => unit_alone(&self.names[k], self.unit(k)).filter(|(of, _)| *of == quantity),
        };
        free.filter_map(|k| own(k).map(|(_, per_si)| (k, per_si))).collect()
    }

    /// The error about everything unclear, and the option that settles it.
    fn unclear(
        &self,
        doubts: &[(Quantity, Doubt)],
        readings: &[Option<Reading>],
        slots: &[Option<Slot>],
    ) -> RecordingError {
        let rows = (self.first_rows)();
        let mut problems: Vec<String> = self.missing(doubts).into_iter().collect();
        for (quantity, doubt) in doubts {
            match doubt {
                Doubt::Missing => {}
                Doubt::Unit(index) if has_no_numbers(&rows, *index) => problems.push(format!(
                    "column '{}' {}, expected {} as numbers{}",
                    self.names[*index],
                    self.instead_of_numbers(*index),
                    quantity.name(),
                    if *quantity == Quantity::Time { OR_DATES } else { "" }
                )),
                Doubt::Unit(index) => problems.push(format!(
                    "column '{}' has no unit that is understood for {}, expected one of {}",
                    self.names[*index],
                    quantity.name(),
                    quantity.unit_list()
                )),
                Doubt::Several(several) => {
                    let names: Vec<String> =
                        several.iter().map(|k| format!("'{}'", self.option(*k))).collect();
                    problems.push(format!(
                        "{} could be {}, expected one",
                        quantity.name(),
                        either(&names)
                    ));
                }
            }
        }
        problems
            .extend(self.angle(doubts).map(|k| format!("column '{}' {AN_ANGLE}", self.names[k])));
        let is_missing = |(_, doubt): &(Quantity, Doubt)| matches!(doubt, Doubt::Missing);
        RecordingError::UnclearColumns {
            file: self.file.to_owned(),
            only_missing: doubts.iter().all(is_missing) && self.angle(doubts).is_none(),
            place: self.place.into(),
            problems: problems.join("; ").into(),
            hint: self.hint(doubts, readings, slots, &rows).into(),
        }
    }

    /// What a column without numbers holds.
    fn instead_of_numbers(&self, column: usize) -> String {
        match (self.first_text)(column) {
            None => "is empty in the first rows".to_owned(),
            Some(Text::WithUnit(cell)) => {
                format!("holds numbers with their unit, such as '{cell}'")
            }
            Some(Text::Other) => "holds text".to_owned(),
        }
    }

    /// All missing quantities in one sentence.
    fn missing(&self, doubts: &[(Quantity, Doubt)]) -> Option<String> {
        let missing = doubts
            .iter()
            .filter(|(_, doubt)| matches!(doubt, Doubt::Missing))
            .map(|(quantity, _)| *quantity);
        let (names, examples): (Vec<String>, Vec<&str>) =
            missing.map(|quantity| (quantity.name().to_owned(), quantity.example())).unzip();
        let expected = if examples.len() == 1 { "a name such as" } else { "names such as" };
        let (found, examples) = (listed(self.names), examples.join(", "));
        (!names.is_empty()).then(|| {
            format!("no {} column among '{found}', expected {expected} {examples}", either(&names))
        })
    }

    fn hint(
        &self,
        doubts: &[(Quantity, Doubt)],
        readings: &[Option<Reading>],
        slots: &[Option<Slot>],
        rows: &[Vec<f64>],
    ) -> String {
        let proposed = self.propose(doubts, readings, slots, rows);
        let entries: Vec<String> = proposed
            .columns
            .iter()
            .filter_map(|(quantity, index, per_si)| entry(*quantity, *per_si, &self.option(*index)))
            .collect();
        let has_no_column =
            |of: &Quantity| proposed.columns.iter().all(|(quantity, ..)| quantity != of);
        let left_out: Vec<Quantity> =
            doubts.iter().map(|(quantity, _)| *quantity).filter(has_no_column).collect();
        let mut sentences = Vec::new();
        // An option that leaves something unclear would fail again; times may follow from a rate.
        if !entries.is_empty() && left_out.iter().all(|quantity| *quantity == Quantity::Time) {
            let option = in_shell(&entries.join(","));
            let caution = caution(&proposed, rows);
            sentences.push(format!(
                "say which column is which, for example --columns {option}{caution}"
            ));
        }
        if self.angle(doubts).is_some() {
            sentences.push(CONVERT_ANGLE.to_owned());
        }
        if !left_out.is_empty() {
            let names: Vec<String> =
                left_out.iter().map(|quantity| quantity.name().to_owned()).collect();
            sentences.push(format!("no column is left that could be {}", either(&names)));
        }
        let cell_has_unit = |doubt: &Doubt| match doubt {
            Doubt::Unit(index) if has_no_numbers(rows, *index) => {
                matches!((self.first_text)(*index), Some(Text::WithUnit(_)))
            }
            _ => false,
        };
        if doubts.iter().any(|(_, doubt)| cell_has_unit(doubt)) {
            sentences.push(UNIT_IN_CELL.to_owned());
        }
        let is_unusable = |(quantity, doubt): &(Quantity, Doubt)| {
            *quantity == Quantity::Time
                && match doubt {
                    Doubt::Missing => true,
                    Doubt::Unit(index) => has_no_numbers(rows, *index),
                    Doubt::Several(_) => false,
                }
        };
        if doubts.iter().any(is_unusable) {
            sentences.push(
                "without a column of times, give the rows per second with --rate-hz".to_owned(),
            );
        }
        sentences.join("; ")
    }

    /// A column for each doubtful quantity, as far as there is one.
    fn propose(
        &self,
        doubts: &[(Quantity, Doubt)],
        readings: &[Option<Reading>],
        slots: &[Option<Slot>],
        rows: &[Vec<f64>],
    ) -> Proposed {
        let mut taken: Vec<usize> = (0..slots.len()).filter(|k| slots[*k].is_some()).collect();
        let mut columns = Vec::new();
        for (quantity, doubt) in doubts {
            match doubt {
                Doubt::Missing => {}
                Doubt::Unit(index) if has_no_numbers(rows, *index) => {}
                Doubt::Unit(index) => columns.push((*quantity, *index)),
                // A force along the instrument changes more than those across it.
                Doubt::Several(several) => {
                    let widest = several.iter().copied().rev().max_by(|a, b| {
                        let range = |k: usize| {
                            let numbers = rows.get(k).map_or(&[][..], Vec::as_slice);
                            let (low, high) = super::range(numbers);
                            if high > low { high - low } else { 0.0 }
                        };
                        range(*a).total_cmp(&range(*b))
                    });
                    columns.extend(widest.map(|index| (*quantity, index)));
                }
            }
        }
        taken.extend(columns.iter().map(|(_, index)| *index));
        let missing = doubts
            .iter()
            .filter(|(_, doubt)| matches!(doubt, Doubt::Missing))
            .map(|(quantity, _)| *quantity);
        let missing: Vec<Quantity> = missing.collect();
        columns.extend(assign(&missing, &self.free(&taken, readings, rows), self.names, rows));
        columns.sort_by_key(|(quantity, _)| *quantity as usize);
        let mut guessed = false;
        let columns = columns.into_iter().map(|(quantity, index)| {
            let own = readings[index]
                .filter(|reading| reading.quantity == quantity)
                .and_then(|reading| reading.per_si);
            let known = own.or_else(|| {
                unit_alone(&self.names[index], self.unit(index))
                    .filter(|(of, _)| *of == quantity)
                    .map(|(_, u)| u)
            });
            guessed |= known.is_none();
            let numbers = rows.get(index).map_or(&[][..], Vec::as_slice);
            (quantity, index, known.unwrap_or_else(|| likely_unit(quantity, numbers)))
        });
        Proposed { columns: columns.collect(), guessed }
    }

    /// Columns that can still be proposed: with numbers, if rows are known.
    fn free(&self, taken: &[usize], readings: &[Option<Reading>], rows: &[Vec<f64>]) -> Vec<usize> {
        let known = rows.iter().any(|column| !column.is_empty());
        let numeric = |k: usize| !known || rows.get(k).is_some_and(|column| !column.is_empty());
        let named = |k: usize| !self.names[k].is_empty() && !is_related(&self.names[k]);
        let of_none = |k: usize| readings[k].is_none() && !self.is_angle(k);
        (0..self.names.len())
            .filter(|k| !taken.contains(k) && of_none(*k) && named(*k) && numeric(*k))
            .collect()
    }
}

/// Columns in order, for `--columns` of a file without names, guessed from its first rows.
pub(crate) fn in_order(rows: &[Vec<f64>]) -> String {
    let needed = [Quantity::Time, Quantity::Position, Quantity::Force];
    let names = vec![String::new(); rows.len()];
    let free: Vec<usize> = (0..rows.len()).filter(|k| !rows[*k].is_empty()).collect();
    let mut words = vec!["-".to_owned(); rows.len()];
    for (quantity, index) in assign(&needed, &free, &names, rows) {
        let unit = quantity.unit_of(likely_unit(quantity, &rows[index])).unwrap_or_default();
        words[index] = format!("{}_{unit}", quantity.name());
    }
    words.join(",")
}

/// Assigns free columns to missing quantities: by weak words, then a column that rises throughout
/// to time, then the smoother one to position.
fn assign(
    missing: &[Quantity],
    free: &[usize],
    names: &[String],
    rows: &[Vec<f64>],
) -> Vec<(Quantity, usize)> {
    let mut free = free.to_vec();
    let mut assigned: Vec<(Quantity, usize)> = Vec::new();
    for quantity in missing {
        let is_word = |k: &usize| {
            words_of(&names[*k]).iter().any(|word| weak_words(*quantity).contains(&word.as_str()))
        };
        if let Some(at) = free.iter().position(is_word) {
            assigned.push((*quantity, free.remove(at)));
        }
    }
    let open = |assigned: &[(Quantity, usize)]| {
        let is_open = |quantity: &&Quantity| assigned.iter().all(|(own, _)| own != *quantity);
        missing.iter().filter(is_open).copied().collect::<Vec<_>>()
    };
    let numbers = |k: usize| rows.get(k).map_or(&[][..], Vec::as_slice);
    if open(&assigned).contains(&Quantity::Time) {
        let rises = |k: &usize| {
            numbers(*k).len() > 1 && numbers(*k).windows(2).all(|pair| pair[1] > pair[0])
        };
        let unknown = free.iter().all(|k| numbers(*k).is_empty());
        if let Some(at) = free.iter().position(|k| unknown || rises(k)) {
            assigned.push((Quantity::Time, free.remove(at)));
        }
    }
    let rest: Vec<Quantity> =
        open(&assigned).into_iter().filter(|quantity| *quantity != Quantity::Time).collect();
    if rest.contains(&Quantity::Position) && rest.contains(&Quantity::Force) {
        // The sort is stable: without numbers the order of the file remains.
        free.truncate(2);
        free.sort_by(|a, b| roughness(numbers(*a)).total_cmp(&roughness(numbers(*b))));
    }
    assigned.extend(rest.into_iter().zip(free));
    assigned
}

fn words_of(name: &str) -> Vec<String> {
    let lower = name.to_lowercase();
    lower
        .split(|c: char| !c.is_alphanumeric() && c != '\'')
        .filter(|word| !word.is_empty())
        .map(str::to_owned)
        .collect()
}

/// Mean second difference as a fraction of the range.
fn roughness(numbers: &[f64]) -> f64 {
    let (low, high) = super::range(numbers);
    let second: f64 = numbers.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs()).sum();
    if high > low { second / (high - low) } else { f64::MAX }
}

/// Units per SI unit that fit the magnitude of the numbers.
fn likely_unit(quantity: Quantity, numbers: &[f64]) -> f64 {
    let (low, high) = super::range(numbers);
    match quantity {
        Quantity::Time => match (high - low) / (numbers.len().max(2) - 1) as f64 {
            1e5.. => 1e9,
            100.0.. => 1e6,
            0.1.. => 1e3,
            // Nothing is known without numbers.
            _ => 1.0,
        },
        Quantity::Position => match high - low {
            500.0.. => 1e6,
            0.5.. => 1e3,
            5e-3.. => 1.0,
            // At rest: the place itself.
            _ if low.abs().max(high.abs()) <= 0.5 && (low != 0.0 || high != 0.0) => 1.0,
            _ => 1e3,
        },
        Quantity::Force | Quantity::Velocity => 1.0,
    }
}

/// States that units in a proposal are a guess.
fn caution(proposed: &Proposed, rows: &[Vec<f64>]) -> &'static str {
    match (proposed.guessed, rows.iter().any(|column| !column.is_empty())) {
        (false, _) => "",
        (true, true) => " (guessed from the first rows: check the units)",
        (true, false) => " (put in your units)",
    }
}

/// `a`, `a or b`, `a, b or c`.
fn either(names: &[String]) -> String {
    match names {
        [front @ .., last] if !front.is_empty() => format!("{} or {last}", front.join(", ")),
        _ => names.join(""),
    }
}

/// An argument as a shell takes it.
fn in_shell(argument: &str) -> String {
    format!("'{}'", argument.replace('\'', r"'\''"))
}
