//! Which column of a header, or of a table, holds which quantity: by name, by unit, or as the
//! caller says.
//!
//! Doubt is an error with all that is unclear at once, and with the option that settles it.

use super::RecordingError;
use super::columns::{
    Given, Layout, Quantity, Reading, Slot, UNIT_IN_CELL, entry, is_related, listed, name_in_front,
    numbered, other_axes, reading_of, reading_with, unit_alone,
};
use super::crtk::axis_of_travel;
use super::statistics::range;
use super::units::{Foreign, foreign, key, lower, words_of};

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
    /// The column named as the time numbers the rows.
    RowNumbers(usize),
}

/// A column as a message proposes it: quantity, index, units per SI unit.
type Proposal = (Quantity, usize, f64);

/// Proposed columns, and whether any unit among them is a guess.
struct Proposed {
    columns: Vec<Proposal>,
    guessed: bool,
}

/// What is known of the columns.
struct Known {
    /// What each column may be by its name and unit.
    readings: Vec<Option<Reading>>,
    /// The columns taken.
    slots: Vec<Option<Slot>>,
    notes: Vec<String>,
    doubts: Vec<(Quantity, Doubt)>,
    /// Whether one is taken by its unit alone.
    by_unit: bool,
}

/// What is unclear, and what is known beside it.
struct Unclear<'a> {
    given: &'a [Given],
    known: &'a Known,
    /// Numbers of the first rows by column.
    rows: Vec<Vec<f64>>,
}

/// Largest force of an instrument in a trocar, N.
pub(crate) const PLAUSIBLE_FORCE: f64 = 200.0;

/// A rate as an example, for a file without times; it stands for any other.
pub(crate) const EXAMPLE_RATE: &str = "‹rate_hz=1000›";
pub(crate) const PUT_IN_RATE: &str = "replace it by your sample rate";

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
        _ => &[],
    }
}

impl Header<'_> {
    /// The layout, with the columns named explicitly in `given`.
    pub(crate) fn layout(
        &self,
        given: &[Given],
        needed: &[Quantity],
    ) -> Result<Layout, RecordingError> {
        let mut known = self.readings();
        for named in given {
            self.take_given(named, &mut known)?;
        }
        known.doubts = self.row_numbers(given)?;
        for quantity in Quantity::ALL {
            if given.iter().all(|given| given.quantity != quantity) {
                self.take(quantity, needed.contains(&quantity), &mut known);
            }
        }
        if !known.doubts.is_empty() {
            let rows = (self.first_rows)();
            return Err(self.unclear(&Unclear { given, known: &known, rows }));
        }
        let Known { slots, notes, by_unit, .. } = known;
        let (names, source) = (self.names.to_vec(), "the header");
        Ok(Layout { names, slots, source, notes, by_unit, ..Layout::default() })
    }

    /// What the columns may be by their names and units.
    fn readings(&self) -> Known {
        let mut notes = Vec::new();
        let mut readings = Vec::with_capacity(self.names.len());
        for (k, name) in self.names.iter().enumerate() {
            // A date has the unit of the file's format, whatever its name says.
            let own = match self.timestamps.contains(&k) {
                true => reading_with(name, "", &mut notes).map(|own| match own.quantity {
                    Quantity::Time => Reading { per_si: Some(1.0), ..own },
                    _ => own,
                }),
                false => reading_of(name, self.unit(k), &mut notes),
            };
            readings.push(own);
        }
        let slots = vec![None; readings.len()];
        Known { readings, slots, notes, doubts: Vec::new(), by_unit: false }
    }

    /// Takes a column that is named.
    fn take_given(&self, named: &Given, known: &mut Known) -> Result<(), RecordingError> {
        let index = named.find(self.names)?;
        let (name, unit) = (&self.names[index], self.unit(index));
        named.check_unit(name, unit)?;
        if known.slots[index].is_some() {
            return Err(RecordingError::named_twice(name));
        }
        let is_date = named.quantity == Quantity::Time && self.timestamps.contains(&index);
        let own = match known.readings[index].take() {
            Some(own) => own.per_si.filter(|_| own.quantity == named.quantity),
            None => named.quantity.declared(unit),
        };
        known.slots[index] = Some(match is_date {
            true => Slot::of(Quantity::Time, 1.0),
            false => named.slot(own)?,
        });
        Ok(())
    }

    /// Takes the column of a quantity that nobody has named, or adds what is unclear.
    fn take(&self, quantity: Quantity, needed: bool, known: &mut Known) {
        match self.choose(quantity, &known.readings) {
            Ok((index, slot, why)) => {
                known.notes.extend(why);
                if known.readings[index].is_some_and(|reading| !reading.exact) {
                    known.notes.push(self.taken(index, quantity));
                }
                known.slots[index] = Some(slot);
            }
            Err(Doubt::Missing) if needed => self.take_by_unit(quantity, known),
            Err(doubt) if needed => known.doubts.push((quantity, doubt)),
            Err(Doubt::Missing) => {}
            Err(Doubt::Unit(index)) => known.notes.push(self.not_used(index, quantity)),
            Err(Doubt::Several(several)) => {
                known.notes.push(self.not_used(several[0], quantity));
            }
            Err(Doubt::RowNumbers(_)) => unreachable!("only of a column that was named"),
        }
    }

    /// Takes the only column that has a unit of a quantity and no name.
    fn take_by_unit(&self, quantity: Quantity, known: &mut Known) {
        let found = self.by_unit(quantity, known);
        match found[..] {
            [(index, per_si)] => {
                let is_date = self.timestamps.contains(&index);
                let why = if is_date { "timestamps" } else { "unit" };
                known.notes.push(format!("{}, by its {why}", self.taken(index, quantity)));
                known.slots[index] = Some(Slot::of(quantity, per_si));
                known.by_unit = true;
            }
            [] => known.doubts.push((quantity, Doubt::Missing)),
            _ => {
                let several = found.iter().map(|(index, _)| *index).collect();
                known.doubts.push((quantity, Doubt::Several(several)));
            }
        }
    }

    fn taken(&self, index: usize, quantity: Quantity) -> String {
        format!("column '{}' taken as {}", self.names[index], quantity.name())
    }

    /// The quantity of a column, by its unit, if it is none of those read.
    fn foreign(&self, column: usize) -> Option<&'static Foreign> {
        let is_date = self.timestamps.contains(&column);
        foreign(&self.names[column], self.unit(column)).map(|(own, _)| own).filter(|_| !is_date)
    }

    /// Columns of another quantity where one is needed, with both.
    fn in_place_of(
        &self,
        doubts: &[(Quantity, Doubt)],
    ) -> Vec<(Quantity, usize, &'static Foreign)> {
        let mut found = Vec::new();
        for quantity in missing(doubts) {
            let mut stands =
                (0..self.names.len()).filter(|k| match name_in_front(&self.names[*k]) {
                    Some(named) if !named.needs_unit() => named == quantity,
                    _ => quantity != Quantity::Time,
                });
            let first = stands.find_map(|k| Some((k, self.foreign(k)?)));
            if let Some((k, foreign)) = first
                && foreign.instead_of.contains(&quantity)
            {
                found.push((quantity, k, foreign));
            }
        }
        found
    }

    /// A column that is named as the time although it numbers the rows.
    fn row_numbers(&self, given: &[Given]) -> Result<Vec<(Quantity, Doubt)>, RecordingError> {
        let Some(time) = given.iter().find(|own| own.quantity == Quantity::Time) else {
            return Ok(Vec::new());
        };
        let index = time.find(self.names)?;
        let name = &self.names[index];
        let numbers_rows = is_called_number(name)
            && name_in_front(name) != Some(Quantity::Time)
            && (self.first_rows)().get(index).is_some_and(|numbers| counts_by_one(numbers));
        Ok(numbers_rows.then_some((Quantity::Time, Doubt::RowNumbers(index))).into_iter().collect())
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

    /// The one column whose name denotes the quantity: exactly, or else among other words; and what
    /// decided between axes.
    fn choose(
        &self,
        quantity: Quantity,
        readings: &[Option<Reading>],
    ) -> Result<(usize, Slot, Option<String>), Doubt> {
        let mut candidates = named(quantity, true, readings);
        if candidates.is_empty() {
            candidates = named(quantity, false, readings);
        }
        let (index, why) = match candidates[..] {
            [] => return Err(Doubt::Missing),
            [first, ..] if quantity == Quantity::Position => self.along(first, candidates)?,
            [index] => (index, None),
            _ => return Err(Doubt::Several(candidates)),
        };
        let per_si = readings[index].and_then(|reading| reading.per_si);
        let per_si = per_si
            .or_else(|| unit_alone(&self.names[index], self.unit(index)).map(|(_, per_si)| per_si));
        per_si.map(|per_si| (index, Slot::of(quantity, per_si), why)).ok_or(Doubt::Unit(index))
    }

    /// Of the coordinates of a place, the one that has nearly all of the travel.
    fn along(
        &self,
        first: usize,
        candidates: Vec<usize>,
    ) -> Result<(usize, Option<String>), Doubt> {
        let mut axes = other_axes(self.names, first);
        axes.push(first);
        axes.sort_unstable();
        if axes.len() == 1 || candidates.iter().any(|k| !axes.contains(k)) {
            return if candidates.len() == 1 {
                Ok((first, None))
            } else {
                Err(Doubt::Several(candidates))
            };
        }
        let rows = (self.first_rows)();
        let ranges: Vec<f64> = axes.iter().map(|k| width(&rows, *k)).collect();
        let Some(longest) = axis_of_travel(&ranges) else { return Err(Doubt::Several(axes)) };
        let names: Vec<&String> = axes.iter().map(|k| &self.names[*k]).collect();
        let all = names.iter().zip(&ranges).map(|(name, range)| format!("{name} {range:.4}"));
        let why = format!(
            "column '{}' taken as position: it has nearly all of the travel (ranges of the first rows: {})",
            names[longest],
            all.collect::<Vec<_>>().join(", ")
        );
        Ok((axes[longest], Some(why)))
    }

    /// Columns, with their units per SI unit, whose names denote no quantity but have a unit of
    /// this one.
    fn by_unit(&self, quantity: Quantity, known: &Known) -> Vec<(usize, f64)> {
        let mut found = Vec::new();
        for k in 0..self.names.len() {
            if known.readings[k].is_some() || known.slots[k].is_some() {
                continue;
            }
            let own = match self.timestamps.contains(&k) {
                true => Some((Quantity::Time, 1.0)),
                false => unit_alone(&self.names[k], self.unit(k)),
            };
            found.extend(own.filter(|(of, _)| *of == quantity).map(|(_, per_si)| (k, per_si)));
        }
        found
    }

    /// The error about everything unclear, and the option that settles it.
    fn unclear(&self, unclear: &Unclear) -> RecordingError {
        let doubts = &unclear.known.doubts[..];
        let mut problems: Vec<String> = self.missing(doubts).into_iter().collect();
        problems.extend(
            doubts.iter().filter_map(|(quantity, doubt)| self.problem(*quantity, doubt, unclear)),
        );
        let in_place = self.in_place_of(doubts);
        problems.extend(in_place.iter().map(|(quantity, k, foreign)| {
            let expected =
                format!("expected {} in {}", quantity.with_article(), quantity.unit_list());
            format!("column '{}' is {}, {expected}", self.names[*k], foreign.what)
        }));
        RecordingError::UnclearColumns {
            file: self.file.to_owned(),
            only_missing: missing(doubts).count() == doubts.len() && in_place.is_empty(),
            place: self.place.into(),
            problems: problems.join("; ").into(),
            hint: self.hint(unclear).into(),
        }
    }

    /// What is unclear about a quantity of which there are columns.
    fn problem(&self, quantity: Quantity, doubt: &Doubt, unclear: &Unclear) -> Option<String> {
        Some(match doubt {
            Doubt::Missing => return None,
            Doubt::Unit(index) if has_no_numbers(&unclear.rows, *index) => format!(
                "column '{}' {}, expected {} as numbers{}",
                self.names[*index],
                self.instead_of_numbers(*index),
                quantity.name(),
                if quantity == Quantity::Time { OR_DATES } else { "" }
            ),
            Doubt::Unit(index) => format!(
                "column '{}' has {} for {}, expected one of {}",
                self.names[*index],
                match unclear.known.readings[*index].is_some_and(|own| own.is_written) {
                    true => "a unit that is not known",
                    false => "no unit that is understood",
                },
                quantity.name(),
                quantity.unit_list()
            ),
            Doubt::Several(several) => {
                let names: Vec<String> =
                    several.iter().map(|k| format!("'{}'", self.option(*k))).collect();
                format!("{} could be {}, expected one", quantity.name(), either(&names))
            }
            Doubt::RowNumbers(index) => {
                format!("column '{}' numbers the rows, expected a time", self.names[*index])
            }
        })
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
        let (names, examples): (Vec<String>, Vec<&str>) = missing(doubts)
            .map(|quantity| (quantity.name().to_owned(), quantity.example()))
            .unzip();
        let expected = if examples.len() == 1 { "a name such as" } else { "names such as" };
        let (found, examples) = (listed(self.names), examples.join(", "));
        (!names.is_empty()).then(|| {
            format!("no {} column among '{found}', expected {expected} {examples}", either(&names))
        })
    }

    fn hint(&self, unclear: &Unclear) -> String {
        let Unclear { given, known: Known { doubts, .. }, rows } = unclear;
        let proposed = self.propose(unclear);
        let of_doubts: Vec<Quantity> = doubts.iter().map(|(quantity, _)| *quantity).collect();
        let mut entries: Vec<String> = given
            .iter()
            .filter(|own| !of_doubts.contains(&own.quantity))
            .map(Given::entry)
            .collect();
        for (of, k, per_si) in &proposed.columns {
            entries.extend(entry(*of, *per_si, &self.option(*k)));
        }
        let mut left_out = of_doubts;
        left_out.retain(|of| proposed.columns.iter().all(|(quantity, ..)| quantity != of));
        let mut sentences = Vec::new();
        // An option that leaves something unclear would fail again; times may follow from a rate.
        if left_out.iter().all(|quantity| *quantity == Quantity::Time) {
            sentences.extend(option(&entries, !left_out.is_empty(), &proposed, rows));
        }
        let in_place = self.in_place_of(doubts);
        sentences.extend(in_place.iter().map(|(.., foreign)| foreign.remedy.to_owned()));
        let mut explained: Vec<Quantity> =
            in_place.iter().map(|(quantity, ..)| *quantity).collect();
        for (quantity, doubt) in doubts {
            if matches!(doubt, Doubt::Unit(_) | Doubt::RowNumbers(_)) {
                explained.push(*quantity);
            }
        }
        let lost: Vec<String> = left_out
            .iter()
            .filter(|quantity| **quantity != Quantity::Time && !explained.contains(quantity))
            .map(|quantity| quantity.name().to_owned())
            .collect();
        if !lost.is_empty() {
            sentences.push(format!(
                "no column is left that could be {}: is it the right file, and its first line the names of the columns? lines above them \
                 are skipped with ‹skip_rows=12›",
                either(&lost)
            ));
        }
        sentences.extend(self.of_units(unclear, &left_out));
        sentences.join("; ")
    }

    /// What to do about units that are not known, or in the cells.
    fn of_units(&self, unclear: &Unclear, left_out: &[Quantity]) -> Vec<String> {
        let mut sentences = Vec::new();
        for (quantity, doubt) in &unclear.known.doubts {
            let Doubt::Unit(index) = *doubt else { continue };
            if !left_out.contains(quantity) {
                continue;
            }
            if !has_no_numbers(&unclear.rows, index) {
                let (name, example) = (&self.names[index], quantity.example());
                sentences.push(format!(
                    "convert '{name}' to one of these units, and write the unit into its name, as in {example}"
                ));
            } else if matches!((self.first_text)(index), Some(Text::WithUnit(_))) {
                sentences.push(UNIT_IN_CELL.to_owned());
            }
        }
        sentences
    }

    /// A column for each doubtful quantity, as far as there is one.
    fn propose(&self, unclear: &Unclear) -> Proposed {
        let Unclear { known: Known { doubts, readings, slots, .. }, rows, .. } = unclear;
        let mut taken: Vec<usize> = (0..slots.len()).filter(|k| slots[*k].is_some()).collect();
        let mut columns = Vec::new();
        for (quantity, doubt) in doubts {
            match doubt {
                Doubt::Missing => {}
                Doubt::RowNumbers(index) => taken.push(*index),
                Doubt::Unit(index) => {
                    taken.push(*index);
                    let is_clear = !has_no_numbers(rows, *index)
                        && self.proposed_unit(*quantity, *index, unclear).is_some();
                    columns.extend(is_clear.then_some((*quantity, *index)));
                }
                // A force along the instrument changes more than those across it.
                Doubt::Several(several) => {
                    let known = several
                        .iter()
                        .copied()
                        .filter(|k| self.proposed_unit(*quantity, *k, unclear).is_some());
                    let widest =
                        known.rev().max_by(|a, b| width(rows, *a).total_cmp(&width(rows, *b)));
                    columns.extend(widest.map(|index| (*quantity, index)));
                }
            }
        }
        taken.extend(columns.iter().map(|(_, index)| *index));
        let missing: Vec<Quantity> = missing(doubts).collect();
        columns.extend(assign(&missing, &self.free(&taken, readings, rows), self.names, rows));
        columns.sort_by_key(|(quantity, _)| *quantity as usize);
        let mut guessed = false;
        let columns = columns.into_iter().filter_map(|(quantity, index)| {
            let (per_si, is_guess) = self.proposed_unit(quantity, index, unclear)?;
            guessed |= is_guess;
            Some((quantity, index, per_si))
        });
        Proposed { columns: columns.collect(), guessed }
    }

    /// The unit of a column as a proposal, and whether it is a guess; `None` if one is written that
    /// is not known.
    fn proposed_unit(
        &self,
        quantity: Quantity,
        index: usize,
        unclear: &Unclear,
    ) -> Option<(f64, bool)> {
        let (name, declared) = (&self.names[index], self.unit(index));
        let own = unclear.known.readings[index].filter(|reading| reading.quantity == quantity);
        if let Some(known) = own.and_then(|own| own.per_si) {
            return Some((known, false));
        }
        if let Some((_, known)) = unit_alone(name, declared).filter(|(of, _)| *of == quantity) {
            return Some((known, false));
        }
        let numbers = unclear.rows.get(index).map_or(&[][..], Vec::as_slice);
        if !own.is_some_and(|own| own.is_written) {
            return Some((likely_unit(quantity, numbers), true));
        }
        // `MN` is hardly a meganewton.
        let text = lower(name).to_lowercase();
        let unit = words_of(&text).last().and_then(|word| quantity.unit(&key(word)));
        unit.map(|unit| (unit.per_si, true))
    }

    /// Columns that can still be proposed: with numbers, if rows are known.
    fn free(&self, taken: &[usize], readings: &[Option<Reading>], rows: &[Vec<f64>]) -> Vec<usize> {
        let mut free: Vec<usize> = (0..self.names.len()).collect();
        free.retain(|k| !taken.contains(k) && !has_no_numbers(rows, *k));
        free.retain(|k| readings[*k].is_none() && self.foreign(*k).is_none());
        free.retain(|k| !is_related(&self.names[*k]));
        free
    }
}

/// Columns whose names denote the quantity: exactly, or among other words.
fn named(quantity: Quantity, exact: bool, readings: &[Option<Reading>]) -> Vec<usize> {
    let readings = readings.iter().enumerate();
    readings
        .filter(|(_, own)| own.is_some_and(|own| own.quantity == quantity && own.exact == exact))
        .map(|(index, _)| index)
        .collect()
}

/// Quantities that no column is.
fn missing(doubts: &[(Quantity, Doubt)]) -> impl Iterator<Item = Quantity> {
    doubts.iter().filter(|(_, doubt)| matches!(doubt, Doubt::Missing)).map(|(own, _)| *own)
}

/// The options for a file without names, with its columns in order, guessed from its first rows;
/// `None` if there are no columns for position and force.
pub(crate) fn in_order(rows: &[Vec<f64>]) -> Option<String> {
    let needed = [Quantity::Time, Quantity::Position, Quantity::Force];
    let names = vec![String::new(); rows.len()];
    let free: Vec<usize> = (0..rows.len()).filter(|k| !rows[*k].is_empty()).collect();
    let mut words = vec!["-".to_owned(); rows.len()];
    let assigned = assign(&needed, &free, &names, rows);
    for (quantity, index) in &assigned {
        let unit = quantity.unit_of(likely_unit(*quantity, &rows[*index])).unwrap_or_default();
        words[*index] = quantity.column_in(unit);
    }
    let found: Vec<Quantity> = assigned.iter().map(|(quantity, _)| *quantity).collect();
    let is_timed = found.contains(&Quantity::Time);
    let rate = if is_timed { String::new() } else { format!(" {EXAMPLE_RATE}") };
    let caution = if is_timed { "" } else { "replace it by your sample rate; " };
    (found.contains(&Quantity::Position) && found.contains(&Quantity::Force)).then(|| {
        let words = words.join(",");
        format!("‹columns={words}›{rate} ({caution}guessed from the first rows: check the units)")
    })
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
        // Row numbers are no times: these follow from a rate.
        let named = free.iter().position(|k| {
            let words = lower(&names[*k]);
            words_of(&words).iter().any(|word| weak_words(*quantity).contains(word))
                && !(*quantity == Quantity::Time && counts_by_one(numbers(rows, *k)))
        });
        if let Some(at) = named {
            assigned.push((*quantity, free.remove(at)));
        }
    }
    let mut rest = missing.to_vec();
    rest.retain(|quantity| assigned.iter().all(|(own, _)| own != quantity));
    if rest.contains(&Quantity::Time) {
        let unknown = free.iter().all(|k| numbers(rows, *k).is_empty());
        if let Some(at) = free.iter().position(|k| unknown || rises(numbers(rows, *k))) {
            assigned.push((Quantity::Time, free.remove(at)));
        }
    }
    free.retain(|k| !counts_by_one(numbers(rows, *k)));
    rest.retain(|quantity| *quantity != Quantity::Time);
    if rest.contains(&Quantity::Position) && rest.contains(&Quantity::Force) {
        // The sort is stable: without numbers the order of the file remains.
        free.truncate(2);
        free.sort_by(|a, b| roughness(numbers(rows, *a)).total_cmp(&roughness(numbers(rows, *b))));
    }
    assigned.extend(rest.into_iter().zip(free));
    assigned
}

/// The numbers of a column in the first rows, if any.
fn numbers(rows: &[Vec<f64>], column: usize) -> &[f64] {
    rows.get(column).map_or(&[], Vec::as_slice)
}

/// Whether the numbers can be times.
fn rises(numbers: &[f64]) -> bool {
    numbers.len() > 1 && numbers.windows(2).all(|pair| pair[1] > pair[0]) && !counts_by_one(numbers)
}

/// Words of a name of row numbers.
const NUMBERS: [&str; 17] = [
    "sample", "samples", "index", "idx", "row", "rows", "no", "nr", "number", "count", "counter",
    "frame", "packet", "seq", "sequence", "line", "n",
];

fn is_called_number(name: &str) -> bool {
    name.trim() == "#" || words_of(&lower(name)).iter().any(|word| NUMBERS.contains(word))
}

/// Whether these are consecutive whole numbers.
pub(crate) fn counts_by_one(numbers: &[f64]) -> bool {
    numbers.len() > 2
        && numbers[0].fract() == 0.0
        && numbers.windows(2).all(|pair| pair[1] - pair[0] == 1.0)
}

/// Range of a column's numbers; 0 without numbers.
fn width(rows: &[Vec<f64>], column: usize) -> f64 {
    let (low, high) = range(numbers(rows, column));
    if high > low { high - low } else { 0.0 }
}

/// Mean second difference as a fraction of the range.
fn roughness(numbers: &[f64]) -> f64 {
    let (low, high) = range(numbers);
    let second: f64 = numbers.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs()).sum();
    if high > low { second / (high - low) } else { f64::MAX }
}

/// Units per SI unit that fit the magnitude of the numbers.
pub(crate) fn likely_unit(quantity: Quantity, numbers: &[f64]) -> f64 {
    let (low, high) = range(numbers);
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
        Quantity::Force => match low.abs().max(high.abs()) {
            size if !size.is_finite() || size <= PLAUSIBLE_FORCE => 1.0,
            size if size <= 1e3 * PLAUSIBLE_FORCE => 1e3,
            _ => 1e6,
        },
        _ => 1.0,
    }
}

/// The option that settles what is unclear, with what is a guess in it.
fn option(
    entries: &[String],
    needs_rate: bool,
    proposed: &Proposed,
    rows: &[Vec<f64>],
) -> Option<String> {
    let columns = (!entries.is_empty()).then(|| format!("‹columns='{}'›", entries.join(",")));
    let rate = needs_rate.then(|| EXAMPLE_RATE.to_owned());
    let what = match (&columns, needs_rate) {
        (None, false) => return None,
        (None, true) => "without a column of times, give the rows per second",
        (Some(_), true) => "say which column is which, and the rows per second",
        (Some(_), false) => "say which column is which",
    };
    let guess = match rows.iter().any(|column| !column.is_empty()) {
        true => "guessed from the first rows: check the units",
        false => "replace them by your units",
    };
    let cautions: Vec<&str> = [(needs_rate, PUT_IN_RATE), (proposed.guessed, guess)]
        .into_iter()
        .filter_map(|(applies, caution)| applies.then_some(caution))
        .collect();
    let caution =
        if cautions.is_empty() { String::new() } else { format!(" ({})", cautions.join("; ")) };
    let options = columns.into_iter().chain(rate).collect::<Vec<_>>().join(" ");
    Some(format!("{what}, for example {options}{caution}"))
}

/// `a`, `a or b`, `a, b or c`.
fn either(names: &[String]) -> String {
    match names {
        [front @ .., last] if !front.is_empty() => format!("{} or {last}", front.join(", ")),
        _ => names.join(""),
    }
}
