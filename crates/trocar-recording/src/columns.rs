//! Column names and units: which column of a file holds which quantity.

use trocar_tables::text::Format;

use super::RecordingError;
pub use super::units::Quantity;
use super::units::{bracketed, foreign, is_unit, key, lower, units_named, words_of};

/// Interpretation of a single name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reading {
    pub(crate) quantity: Quantity,
    /// The name is exactly the quantity's word.
    pub(crate) exact: bool,
    /// Number of the column's units per SI unit.
    pub(crate) per_si: Option<f64>,
    /// Whether a unit is written, known or not.
    pub(crate) is_written: bool,
}

/// Words in names of columns that are related to a quantity but not its measurement.
const NOT_MEASURED: [&str; 14] = [
    "command",
    "commanded",
    "cmd",
    "setpoint",
    "set",
    "target",
    "reference",
    "ref",
    "desired",
    "demand",
    "error",
    "std",
    "soll",
    "sollwert",
];

/// Whether a name denotes a quantity that is not measured, such as a setpoint.
pub(crate) fn is_related(name: &str) -> bool {
    words_of(&lower(name)).iter().any(|word| NOT_MEASURED.contains(word))
}

/// Units of force that are masses rather than forces, without a word that says so.
const MASSES: [&str; 9] = ["g", "kg", "lb", "lbs", "oz", "gram", "grams", "pound", "pounds"];

/// Units that are also something else: a minimum, an inlet, a force-torque sensor.
const WEAK_UNITS: [&str; 6] = ["min", "in", "h", "ft", "mil", "foot"];

/// The quantity that a name without any of its words denotes by its unit alone, as `Weg [mm]` or
/// `Fz_n`, and the number of units per SI unit. Never an optional quantity.
pub(crate) fn unit_alone(name: &str, declared: &str) -> Option<(Quantity, f64)> {
    let lower = lower(name);
    let words = words_of(&lower);
    let mut of_quantities = Quantity::ALL.iter().flat_map(|quantity| quantity.words());
    if is_related(name) || of_quantities.any(|word| words.contains(word)) {
        return None;
    }
    let unit = match bracketed(&lower) {
        Some((_, unit)) => key(unit),
        None if !declared.is_empty() => key(&self::lower(declared)),
        None => {
            let [front @ .., before, last] = &words[..] else { return None };
            // `n_mm` is a stiffness, `mm_s` a velocity; `s_mm` is the usual letter for a path, and
            // `in` a preposition.
            let is_unit =
                units_named(before).next().is_some() || before.bytes().all(|b| b.is_ascii_digit());
            let harmless = *before == "in" || (*before == "s" && front.is_empty());
            let front = lower.trim_end().strip_suffix(last).unwrap_or_default();
            if (is_unit && !harmless)
                || WEAK_UNITS.contains(last)
                || !front.ends_with(['_', ' ', '/', ','])
            {
                return None;
            }
            (*last).to_owned()
        }
    };
    let mut found = units_named(&unit).filter(|_| !MASSES.contains(&unit.as_str()));
    found.next().filter(|(quantity, _)| Quantity::NEEDED.contains(quantity))
}

/// Recognises `force_N`, `Position (mm)`, `time [s]`, `t_ms`, `velocity m/s`.
fn recognise(name: &str) -> Option<Reading> {
    let lower = lower(name);
    let words = words_of(&lower);
    // `X_Value` is the time in LabVIEW's files.
    if words.iter().any(|word| NOT_MEASURED.contains(word)) || words[..] == ["x", "value"] {
        return None;
    }
    // What is in brackets behind a quantity is its unit, also one that is not known.
    let front = bracketed(&lower).map(|(front, unit)| (words_of(front), key(unit)));
    if let Some((front, unit)) = front
        && let Some(quantity) = quantity_of(&front)
        && quantity_of(&words) == Some(quantity)
    {
        let known = quantity.unit(&unit).map(|unit| unit.per_si);
        let is_exact = front.len() == 1 && front[0] != "stamp";
        return Some(Reading { quantity, exact: is_exact, per_si: known, is_written: true });
    }
    let quantity = quantity_of(&words)?;
    let (count, per_si) = match trailing_unit(&words, quantity) {
        Some((count, per_si)) => (count, Some(per_si)),
        None => (0, None),
    };
    // A stamp is a time, but a column that is called time comes first.
    let exact = words.len() - count == 1 && words[0] != "stamp";
    // `position_kg` has a unit, though none of positions.
    let is_written = per_si.is_some() || words[1..].last().is_some_and(|last| is_unit(last));
    Some(Reading { quantity, exact, per_si, is_written })
}

/// Interpretation of a name together with its declared unit; the unit in the name takes precedence.
pub(crate) fn reading_with(name: &str, unit: &str, notes: &mut Vec<String>) -> Option<Reading> {
    let mut own = recognise(name)?;
    if key(&lower(unit)).is_empty() {
        return Some(own);
    }
    let per_si = own.quantity.declared(unit);
    if own.per_si.is_none() {
        (own.per_si, own.is_written) = (per_si, true);
    } else if own.per_si != per_si {
        notes.push(format!("column '{name}' is declared in {unit}: the unit in its name is taken"));
    }
    Some(own)
}

/// The same of a column that may be read: an angle is no position, and a voltage no force, even if nothing
/// else is.
pub(crate) fn reading_of(name: &str, unit: &str, notes: &mut Vec<String>) -> Option<Reading> {
    reading_with(name, unit, notes).filter(|own| match own.quantity.needs_unit() {
        true => own.per_si.is_some(),
        false => foreign(name, unit).is_none(),
    })
}

/// The quantity whose word the name contains; `None` for two different ones.
fn quantity_of(words: &[&str]) -> Option<Quantity> {
    let mut found = Quantity::ALL.into_iter().filter(|quantity| {
        words.iter().any(|word| *word != AXES[0] && quantity.words().contains(word))
    });
    let has_x = words.contains(&AXES[0]);
    match (found.next(), found.next()) {
        // `force_torque_fz` is a force, `roll_torque` none but a torque.
        (Some(Quantity::Force), Some(Quantity::Torque | Quantity::Pressure)) => {
            Some(Quantity::Force)
        }
        (
            Some(Quantity::Angle | Quantity::Force),
            Some(own @ (Quantity::Torque | Quantity::Tilt | Quantity::SideForce)),
        ) => Some(own),
        // Beside another word x is an axis, but `x(t)` is none.
        (Some(quantity), None) => Some(quantity).filter(|own| !has_x || *own != Quantity::Time),
        (None, _) => has_x.then_some(Quantity::Position),
        _ => None,
    }
}

/// Axes of a place or of a force.
const AXES: [&str; 3] = ["x", "y", "z"];

/// The columns of the other axes beside that of one axis: the same name but for a letter.
pub(crate) fn other_axes(names: &[String], index: usize) -> Vec<usize> {
    let lower: Vec<String> = names.iter().map(|name| lower(name)).collect();
    let own = words_of(&lower[index]);
    let mut others: Vec<usize> = (0..names.len()).collect();
    others.retain(|k| {
        let words = words_of(&lower[*k]);
        let mut unlike = words.iter().zip(&own).filter(|(a, b)| a != b);
        let (first, more) = (unlike.next(), unlike.next().is_some());
        let are_axes = first.is_some_and(|(a, b)| AXES.contains(a) && AXES.contains(b));
        words.len() == own.len() && !more && are_axes
    });
    others
}

/// The unit at the end of a name behind another word: how many words, and the number per SI unit.
fn trailing_unit(words: &[&str], quantity: Quantity) -> Option<(usize, f64)> {
    let power = usize::from(words.len() > 2 && words.last() == Some(&"1"));
    [2, 1].into_iter().find_map(|parts| {
        let at = words.len().checked_sub(power + parts).filter(|&at| at > 0)?;
        let unit = words[at..words.len() - power].join("_");
        Some((power + parts, quantity.unit(&unit)?.per_si))
    })
}

/// A column to read: the destination of its numbers, and the divisor that converts them to SI,
/// negative if the sign is reversed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Slot {
    /// A [`Quantity`], or an index of the reader's own.
    pub(crate) output: usize,
    pub(crate) per_si: f64,
}

impl Slot {
    pub(crate) fn of(quantity: Quantity, per_si: f64) -> Self {
        Self { output: quantity as usize, per_si }
    }

    pub(crate) fn is(&self, quantity: Quantity) -> bool {
        self.output == quantity as usize
    }
}

/// Source of a layout that reads all columns.
const ALL_COLUMNS: &str = "the first line";

/// The columns of one file.
#[derive(Debug, Clone, Default)]
pub(crate) struct Layout {
    pub(crate) names: Vec<String>,
    pub(crate) slots: Vec<Option<Slot>>,
    /// Source of the names, for messages.
    pub(crate) source: &'static str,
    /// Assumptions about them.
    pub(crate) notes: Vec<String>,
    /// Whether a quantity is taken by its unit alone.
    pub(crate) by_unit: bool,
    /// Whether the columns are topics of a log, with its clock.
    pub(crate) is_log: bool,
    /// Rows per second, if times are not in the file.
    pub(crate) rate_hz: Option<f64>,
    /// The first time in ns since 1970, if times are timestamps in text.
    pub(crate) origin: Option<i64>,
}

impl Layout {
    pub(crate) fn has(&self, quantity: Quantity) -> bool {
        (quantity == Quantity::Time && self.rate_hz.is_some()) || self.column(quantity).is_some()
    }

    /// Index of the column of a quantity.
    pub(crate) fn column(&self, quantity: Quantity) -> Option<usize> {
        self.slots.iter().position(|slot| slot.is_some_and(|slot| slot.is(quantity)))
    }

    /// All columns unchanged.
    pub(crate) fn all(names: Vec<String>) -> Self {
        let slots = (0..names.len()).map(|output| Some(Slot { output, per_si: 1.0 })).collect();
        Self { names, slots, source: ALL_COLUMNS, ..Self::default() }
    }

    /// Whether a non-numeric cell counts as missing: if all columns are read, most of them are
    /// irrelevant.
    pub(crate) fn tolerates_text(&self) -> bool {
        self.source == ALL_COLUMNS
    }

    /// The column of each quantity, in the syntax of `--columns`.
    pub(crate) fn words(&self) -> Vec<String> {
        self.words_with(|_, per_si| Some(per_si))
    }

    /// The same with other units; a quantity for which there is none is left out.
    pub(crate) fn words_with(&self, unit: impl Fn(Quantity, f64) -> Option<f64>) -> Vec<String> {
        let mut words = Vec::new();
        for quantity in Quantity::ALL {
            if let Some(k) = self.column(quantity)
                && let Some(per_si) = unit(quantity, self.slots[k].map_or(1.0, |slot| slot.per_si))
            {
                words.extend(entry(quantity, per_si, &numbered(&self.names, k)));
            }
        }
        words
    }

    /// Takes times from the rate, not from a column.
    pub(crate) fn at_rate(mut self, rate_hz: Option<f64>) -> Self {
        let Some(rate) = rate_hz else { return self };
        for (slot, name) in self.slots.iter_mut().zip(&self.names) {
            if slot.take_if(|slot| slot.is(Quantity::Time)).is_some() {
                self.notes.push(format!("column '{name}' not used: times follow from the rate"));
            }
        }
        self.notes.push(format!("times from 0 at {rate} rows per second"));
        self.rate_hz = rate_hz;
        self
    }

    /// The value of `--columns` that reverses the sign of the position and leaves the rest as it
    /// was chosen with `given`.
    pub(crate) fn reversed_position(&self, given: Option<&str>) -> Option<String> {
        if let Some(in_order) = given.filter(|given| !given.contains('=')) {
            let words = in_order.split(',').map(|word| match word.trim().strip_prefix('-') {
                Some(front) if is_position(front) => front.to_owned(),
                None if is_position(word) => format!("-{}", word.trim()),
                _ => word.to_owned(),
            });
            return Some(words.collect::<Vec<_>>().join(","));
        }
        let mut words = self.words_with(|quantity, per_si| {
            Some(if quantity == Quantity::Position { -per_si } else { per_si })
        });
        if given.is_none() {
            words.retain(|word| is_position(word));
        }
        (!words.is_empty()).then(|| words.join(","))
    }

    /// Reverses the sign of the force.
    pub(crate) fn flip_force(&mut self) {
        let slots = self.slots.iter_mut().flatten();
        slots.filter(|slot| slot.is(Quantity::Force)).for_each(|slot| slot.per_si = -slot.per_si);
        self.notes.push("sign of the force reversed".into());
    }

    /// Layout from `--columns time_s,position_mm,-,force_n`.
    pub(crate) fn from_mapping(mapping: &str, needed: &[Quantity]) -> Result<Self, RecordingError> {
        let names: Vec<String> = mapping.split(',').map(|name| name.trim().to_owned()).collect();
        let slots = names.iter().map(|name| mapped_slot(name)).collect::<Result<Vec<_>, _>>()?;
        let layout = Self { names, slots, source: "‹columns›", ..Self::default() };
        for quantity in Quantity::ALL {
            let mut taken = layout.slots.iter().flatten().filter(|slot| slot.is(quantity));
            let count = taken.by_ref().count();
            if count > 1 || (count == 0 && needed.contains(&quantity)) {
                let problem = format!("naming {} {count} times, expected once", quantity.name());
                return Err(RecordingError::bad_columns(mapping, problem));
            }
        }
        Ok(layout)
    }
}

/// An entry of `--columns`, such as `force_mn=-load`; a negative `per_si` reverses the sign, and one that no
/// unit has is a factor, as in `force_n=22.2*U`. `None` if there is no SI unit.
pub(crate) fn entry(quantity: Quantity, per_si: f64, name: &str) -> Option<String> {
    let (unit, factor) = match quantity.unit_of(per_si.abs()) {
        Some(unit) => (unit, None),
        None => (quantity.unit_of(1.0)?, Some(1.0 / per_si.abs())),
    };
    Some(written(&quantity.column_in(unit), per_si < 0.0, factor, name))
}

fn written(what: &str, reversed: bool, factor: Option<f64>, name: &str) -> String {
    let minus = if reversed { "-" } else { "" };
    let factor = factor.map_or_else(String::new, |factor| format!("{factor}*"));
    format!("{what}={minus}{factor}{}", quoted(name))
}

/// The name of a column in `--columns`, in double quotes where it needs them.
fn quoted(name: &str) -> String {
    let plain = !name.contains([',', '*']) && !name.starts_with(['-', '"']) && name.trim() == name;
    if plain { name.to_owned() } else { format!("\"{name}\"") }
}

/// Whether an entry of a mapping names the position.
fn is_position(word: &str) -> bool {
    let quantity = recognise(word.split('=').next().unwrap_or_default());
    quantity.is_some_and(|reading| reading.quantity == Quantity::Position)
}

fn mapped_slot(name: &str) -> Result<Option<Slot>, RecordingError> {
    if matches!(name, "-" | "skip" | "") {
        return Ok(None);
    }
    let bad = |problem: String| RecordingError::bad_columns(name, problem);
    let (name, reversed) = match name.strip_prefix('-') {
        Some(front) => (front.trim(), true),
        None => (name, false),
    };
    let read_as = recognise(name).map_or(Quantity::Force, |reading| reading.quantity);
    if let Some((foreign, _)) = foreign(name, "").filter(|(own, _)| own.own != Some(read_as)) {
        return Err(bad(foreign.refused(read_as)));
    }
    let reading = recognise(name)
        .ok_or_else(|| bad(format!("not understood, expected {}", quantity_list())))?;
    let per_si = reading.per_si.ok_or_else(|| {
        bad(format!("without a unit, expected one of {}", reading.quantity.unit_list()))
    })?;
    Ok(Some(Slot::of(reading.quantity, if reversed { -per_si } else { per_si })))
}

/// All quantities, for messages.
fn quantity_list() -> String {
    let [front @ .., last] = Quantity::ALL.map(Quantity::name);
    format!("{} or {last}", front.join(", "))
}

/// The entries of `--columns`, separated by commas except within a name that begins and ends with
/// double quotes.
fn entries(mapping: &str) -> Result<Vec<&str>, RecordingError> {
    let (mut found, mut begin, mut quoted) = (Vec::new(), 0, false);
    for (at, c) in mapping.char_indices() {
        let rest = mapping[at + c.len_utf8()..].trim_start();
        match c {
            '"' if quoted => quoted = !(rest.is_empty() || rest.starts_with(',')),
            '"' => {
                let front = mapping[begin..at].split_once('=').map(|(_, front)| front);
                quoted = front.is_some_and(|front| {
                    front.trim_end().ends_with('*')
                        || front.chars().all(|c| c == '-' || c.is_whitespace())
                });
            }
            ',' if !quoted => {
                found.push(&mapping[begin..at]);
                begin = at + 1;
            }
            _ => {}
        }
    }
    let entry = &mapping[begin..];
    if quoted {
        let problem = "without the double quote that ends its name".to_owned();
        return Err(RecordingError::bad_columns(entry, problem));
    }
    found.push(entry);
    Ok(found)
}

/// An entry `force_n=-22.2*fz` of `--columns`: a quantity, and the name of its column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Given {
    pub(crate) quantity: Quantity,
    /// Unit declared in the entry; otherwise the column's own name must give it.
    per_si: Option<f64>,
    pub(crate) column: String,
    pub(crate) reversed: bool,
    /// By which the column is multiplied, above 0: the calibration of a sensor.
    factor: Option<f64>,
}

/// The name of a column, followed by `#` and its number among those of the same name if there are
/// several.
pub(crate) fn numbered(names: &[String], index: usize) -> String {
    let name = &names[index];
    let [before, all] =
        [&names[..index], names].map(|names| names.iter().filter(|own| *own == name).count());
    match all {
        1 if !name.is_empty() => name.clone(),
        _ => format!("{name}#{}", before + 1),
    }
}

impl Given {
    /// All entries of `--columns time_s=t,position_mm=x,force_n=-fz`; a name in double quotes may
    /// contain commas.
    pub(crate) fn parse(mapping: &str) -> Result<Vec<Self>, RecordingError> {
        let given =
            entries(mapping)?.into_iter().map(Self::parse_one).collect::<Result<Vec<_>, _>>()?;
        for (k, entry) in given.iter().enumerate() {
            if given[..k].iter().any(|other| other.quantity == entry.quantity) {
                let problem = format!("naming {} more than once", entry.quantity.name());
                return Err(RecordingError::bad_columns(mapping, problem));
            }
        }
        Ok(given)
    }

    fn parse_one(entry: &str) -> Result<Self, RecordingError> {
        let bad = |problem: &str| RecordingError::bad_columns(entry, problem.to_owned());
        let (what, column) = entry
            .split_once('=')
            .ok_or_else(|| bad("without '=', while others have one: name all by column"))?;
        let reading = recognise(what).ok_or_else(|| {
            bad(&format!("not understood, expected {} in front of '='", quantity_list()))
        })?;
        if reading.per_si.is_none() && !reading.exact {
            let units = reading.quantity.unit_list();
            return Err(bad(&format!("in a unit that is not understood, expected one of {units}")));
        }
        let column = column.trim();
        let reversed = column.starts_with('-');
        let column = column.trim_start_matches('-').trim();
        let scaled = column.split_once('*');
        let scaled = scaled.and_then(|(text, name)| Some((text.trim().parse::<f64>().ok()?, name)));
        let (factor, column) = scaled.map_or((None, column), |(f, name)| (Some(f), name.trim()));
        if factor.is_some_and(|factor| !(factor.is_finite() && factor > 0.0)) {
            return Err(bad("with a factor that is not a number above 0; a minus reverses a sign"));
        }
        if factor.is_some() && reading.per_si.is_none() {
            let units = reading.quantity.unit_list();
            return Err(bad(&format!("with a factor to no unit, expected one of {units}")));
        }
        let unquoted = column.strip_prefix('"').and_then(|column| column.strip_suffix('"'));
        let column = unquoted.unwrap_or(column).to_owned();
        if column.is_empty() {
            return Err(bad("without the name of a column behind '='"));
        }
        Ok(Self { quantity: reading.quantity, per_si: reading.per_si, column, reversed, factor })
    }

    /// The entry as [`Given::parse`] takes it.
    pub(crate) fn entry(&self) -> String {
        let name = self.quantity.name();
        let unit = self.per_si.and_then(|per_si| self.quantity.unit_of(per_si));
        let what = unit.map_or_else(|| name.to_owned(), |unit| self.quantity.column_in(unit));
        written(&what, self.reversed, self.factor, &self.column)
    }

    /// Index of the column among `names`: the same name, with its number if several columns have
    /// it, or the only one that differs only in case.
    pub(crate) fn find(&self, names: &[String]) -> Result<usize, RecordingError> {
        let named = |name: &str| (0..names.len()).filter(|k| names[*k] == name).collect::<Vec<_>>();
        // One of several columns of a name by its number, unless that is itself a name.
        let own = named(&self.column);
        if let [index] = own[..] {
            return Ok(index);
        }
        let numbered_as = self.column.rsplit_once('#').filter(|_| own.is_empty());
        if let Some((name, Ok(number))) = numbered_as.map(|(name, n)| (name, n.parse::<usize>())) {
            let all = named(name);
            let is_numbered = all.len() > 1 || name.is_empty();
            if let (true, Some(index)) = (is_numbered, all.get(number.wrapping_sub(1))) {
                return Ok(*index);
            }
        }
        let same: Vec<String> = (0..names.len())
            .filter(|k| names[*k] == self.column)
            .map(|k| numbered(names, k))
            .collect();
        if !same.is_empty() {
            let problem =
                format!("the name of {} columns, expected one of {}", same.len(), listed(&same));
            return Err(RecordingError::bad_columns(&*self.column, problem));
        }
        let mut like = (0..names.len()).filter(|k| names[*k].eq_ignore_ascii_case(&self.column));
        match (like.next(), like.next()) {
            (Some(index), None) => Ok(index),
            _ => {
                let problem =
                    format!("a name that no column has, expected one of {}", listed(names));
                Err(RecordingError::bad_columns(&*self.column, problem))
            }
        }
    }

    /// Rejects a column of another quantity, such as angles or volts, by the unit of its name or by
    /// its declared one. A factor is what makes a force of volts.
    pub(crate) fn check_unit(&self, name: &str, declared: &str) -> Result<(), RecordingError> {
        let found = foreign(name, declared).filter(|_| self.factor.is_none());
        match found.filter(|(own, _)| own.own != Some(self.quantity)) {
            Some((foreign, is_alone))
                if is_alone || foreign.instead_of.contains(&self.quantity) =>
            {
                let entry = format!("{}={name}", self.quantity.name());
                Err(RecordingError::bad_columns(entry, foreign.refused(self.quantity)))
            }
            _ => Ok(()),
        }
    }

    /// Slot with the unit of the entry, otherwise with that of the column, `own`.
    pub(crate) fn slot(&self, own: Option<f64>) -> Result<Slot, RecordingError> {
        let per_si = self.per_si.or(own).ok_or_else(|| {
            let units = self.quantity.unit_list();
            let problem = format!(
                "{} without a unit, and the column's name has none either, expected one of {units}",
                self.quantity.name()
            );
            RecordingError::bad_columns(
                format!("{}={}", self.quantity.name(), self.column),
                problem,
            )
        })?;
        let sign = if self.reversed { -1.0 } else { 1.0 };
        Ok(Slot::of(self.quantity, sign * per_si / self.factor.unwrap_or(1.0)))
    }
}

/// Names for a message, the first few of many.
pub(crate) fn listed(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let shown = names.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN { format!("{shown}, ... ({} in all)", names.len()) } else { shown }
}

/// The unit at the end of a name that denotes one of the quantities.
pub fn unit_in(name: &str) -> Option<&'static str> {
    let Reading { quantity, per_si, .. } = recognise(name)?;
    quantity.units().iter().find(|unit| Some(unit.per_si) == per_si).map(|unit| unit.symbol)
}

/// Units per second of a column of times, if known; `None` if it is not a column of times.
pub fn time_unit(name: &str, unit: Option<&str>) -> Option<Option<f64>> {
    let reading = reading_with(name, unit.unwrap_or_default(), &mut Vec::new())?;
    (reading.quantity == Quantity::Time).then_some(reading.per_si)
}

/// The quantity that a name denotes.
pub(crate) fn quantity_named(name: &str) -> Option<Quantity> {
    recognise(name).map(|reading| reading.quantity)
}

/// The quantity that the words in front of a unit denote.
pub(crate) fn name_in_front(name: &str) -> Option<Quantity> {
    let lower = lower(name);
    let words = words_of(bracketed(&lower).map_or(&*lower, |(front, _)| front));
    quantity_of(&words).or_else(|| quantity_of(words.split_last()?.1))
}

/// Whether the name denotes one of the quantities.
pub(crate) fn is_recognised(name: &str) -> bool {
    recognise(name).is_some()
}

/// Remedy for a cell with a number and its unit.
pub(crate) const UNIT_IN_CELL: &str = "write the numbers alone into the cells and the unit into the name of the column, such as force_n";

/// Whether a cell is a number with its unit, such as `1.2 N`.
pub(crate) fn has_unit(cell: &str, format: Format) -> bool {
    cell.char_indices().any(|(at, _)| {
        let (number, unit) = cell.split_at(at);
        format.number(number.as_bytes()).is_some_and(f64::is_finite)
            && units_named(&key(&lower(unit))).next().is_some()
    })
}

/// Whether every cell is only a unit, as in the second header line of some loggers.
pub(crate) fn is_unit_row(cells: &[String]) -> bool {
    cells.iter().filter(|cell| is_unit(cell)).count() >= 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_alone_denotes_a_quantity_unless_it_is_a_part_of_another() {
        for (name, declared, quantity) in [
            ("Zeit [s]", "", Some((Quantity::Time, 1.0))),
            ("Weg (mm)", "", Some((Quantity::Position, 1e3))),
            ("Weg/mm", "", Some((Quantity::Position, 1e3))),
            ("s [mm]", "", Some((Quantity::Position, 1e3))),
            ("Kraft in N", "", Some((Quantity::Force, 1.0))),
            ("Kraft", "N", Some((Quantity::Force, 1.0))),
            ("Fz_n", "", Some((Quantity::Force, 1.0))),
            ("Dauer [min]", "", Some((Quantity::Time, 1.0 / 60.0))),
            ("Geschwindigkeit [mm/s]", "", None),
            ("Steifigkeit [N/mm]", "", None),
            ("Steifigkeit N/mm", "", None),
            ("Beschleunigung [m/s^2]", "", None),
            ("Moment [N m]", "", None),
            ("Frequenz [1/s]", "", None),
            ("Masse [kg]", "", None),
            ("Temp_min", "", None),
            ("it's", "", None),
            ("Weg Sollwert [mm]", "", None),
            ("s", "", None),
        ] {
            assert_eq!(unit_alone(name, declared), quantity, "{name}");
        }
    }

    fn reading(name: &str) -> Option<(Quantity, bool, Option<f64>)> {
        recognise(name).map(|r| (r.quantity, r.exact, r.per_si))
    }

    #[test]
    fn names_with_units_are_understood_in_many_spellings() {
        for (name, quantity, per_si) in [
            ("force_N", Quantity::Force, 1.0),
            ("Force (mN)", Quantity::Force, 1e3),
            ("f_kn", Quantity::Force, 1e-3),
            ("Position (mm)", Quantity::Position, 1e3),
            ("position_µm", Quantity::Position, 1e6),
            ("x_cm", Quantity::Position, 1e2),
            ("time [s]", Quantity::Time, 1.0),
            ("t_ms", Quantity::Time, 1e3),
            ("Timestamp/ns", Quantity::Time, 1e9),
            ("velocity_m_s", Quantity::Velocity, 1.0),
            ("Velocity [mm/s]", Quantity::Velocity, 1e3),
            ("force_gf", Quantity::Force, 1e3 / 9.80665),
            ("load (g)", Quantity::Force, 1e3 / 9.80665),
            ("Load [kg]", Quantity::Force, 1.0 / 9.80665),
            ("force (lbf)", Quantity::Force, 1.0 / 4.4482216152605),
            ("f_ozf", Quantity::Force, 16.0 / 4.4482216152605),
            ("Position (inches)", Quantity::Position, 1.0 / 0.0254),
            ("x_in", Quantity::Position, 1.0 / 0.0254),
            ("t_µs", Quantity::Time, 1e6),
            ("elapsed (min)", Quantity::Time, 1.0 / 60.0),
            ("v (m·s^-1)", Quantity::Velocity, 1.0),
            ("F [daN]", Quantity::Force, 0.1),
            ("F / daN", Quantity::Force, 0.1),
            ("F_daN", Quantity::Force, 0.1),
            ("F_cN", Quantity::Force, 1e2),
            ("F [kp]", Quantity::Force, 1.0 / 9.80665),
            ("F (pond)", Quantity::Force, 1e3 / 9.80665),
            ("force_dyn", Quantity::Force, 1e5),
            ("F [μN]", Quantity::Force, 1e6),
            ("position (ft)", Quantity::Position, 1.0 / 0.3048),
            ("pos_mil", Quantity::Position, 1e3 / 0.0254),
            ("x [nm]", Quantity::Position, 1e9),
            ("x {µm}", Quantity::Position, 1e6),
            ("time [h]", Quantity::Time, 1.0 / 3600.0),
            ("v [mm/min]", Quantity::Velocity, 60e3),
        ] {
            let (own, exact, unit) = reading(name).unwrap_or_else(|| panic!("{name}"));
            let unit = unit.unwrap_or_else(|| panic!("{name}"));
            assert_eq!((own, exact), (quantity, true), "{name}");
            assert!((unit / per_si - 1.0).abs() < 1e-15, "{name}: {unit} instead of {per_si}");
        }
    }

    #[test]
    fn angles_are_known_by_their_units() {
        for (name, declared) in [
            ("position_deg", ""),
            ("Position [rad]", ""),
            ("pos (°)", ""),
            ("encoder angle deg", ""),
            ("position", "deg"),
            ("position", "rad"),
            ("x", "°"),
        ] {
            let found = foreign(name, declared).map(|(own, _)| own.what);
            assert_eq!(found, Some("an angle"), "{name} {declared}");
        }
        for (name, declared) in [
            ("position_mm", ""),
            ("radius_mm", ""),
            ("temperature (°C)", ""),
            ("velocity_deg/s", ""),
            ("stiffness", "N m/rad"),
            ("position", "mm"),
        ] {
            assert!(foreign(name, declared).is_none(), "{name} {declared}");
        }
    }

    #[test]
    fn other_quantities_are_known_by_their_units() {
        for (name, declared, what) in [
            ("F [V]", "", Some("a voltage")),
            ("F (mV/V)", "", Some("a voltage")),
            ("F_V", "", Some("a voltage")),
            ("F / V", "", Some("a voltage")),
            ("F", "V", Some("a voltage")),
            ("load [A]", "", Some("a current")),
            ("F [kPa]", "", Some("a pressure")),
            ("force_bar", "", Some("a pressure")),
            ("F [Nm]", "", Some("a torque")),
            ("F", "N m", Some("a torque")),
            ("torque_nm", "", Some("a torque")),
            ("pos [counts]", "", Some("a count")),
            ("pos_ticks", "", Some("a count")),
            // Letters of channels, calibrations, compounds, and units that are read.
            ("force_a", "", None),
            ("x_v", "", None),
            ("gain [N/V]", "", None),
            ("gain N/V", "", None),
            ("F [N]", "", None),
            ("x [nm]", "", None),
        ] {
            assert_eq!(foreign(name, declared).map(|(own, _)| own.what), what, "{name} {declared}");
        }
    }

    #[test]
    fn a_minus_reverses_the_sign_in_order_and_by_name() {
        let layout = Layout::from_mapping("time_s,-position_mm,force_n", &[]).unwrap();
        assert_eq!(layout.slots[1], Some(Slot::of(Quantity::Position, -1e3)));
        let given = Given::parse("position_mm=-\"load, filtered\"").unwrap();
        assert_eq!((&*given[0].column, given[0].reversed), ("load, filtered", true));
        assert_eq!(
            layout.reversed_position(Some("time_s,-position_mm,-,force_n")).unwrap(),
            "time_s,position_mm,-,force_n"
        );
        assert_eq!(
            layout.reversed_position(Some("time_s, position_mm,force_n")).unwrap(),
            "time_s,-position_mm,force_n"
        );
    }

    #[test]
    fn doubtful_names_are_not_taken_for_measurements() {
        assert_eq!(reading("position_setpoint_mm"), None);
        assert_eq!(reading("status"), None);
        assert_eq!(reading("s"), None);
        // Units that are not known are no units, in particular not those of SI.
        assert_eq!(reading("force_foo"), Some((Quantity::Force, false, None)));
        assert_eq!(reading("position (foo)"), Some((Quantity::Position, true, None)));
        assert_eq!(reading("position_kg"), Some((Quantity::Position, false, None)));
        assert_eq!(reading("stamp_ticks"), Some((Quantity::Time, false, None)));
        assert_eq!(reading("stamp_ns"), Some((Quantity::Time, false, Some(1e9))));
        assert_eq!(reading("force"), Some((Quantity::Force, true, None)));
        assert_eq!(reading("motor_position_mm"), Some((Quantity::Position, false, Some(1e3))));
    }
}
