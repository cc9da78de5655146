//! Column names and units: which column of a file holds which quantity.

use super::RecordingError;
use super::format::Format;
use super::header::Header;

/// Quantities that a column can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Time, in s.
    Time,
    /// Position, in m.
    Position,
    /// Force, in N.
    Force,
    /// Velocity, in m/s.
    Velocity,
}

/// A unit as written in a name, and its number per SI unit.
type Unit = (&'static str, f64);

/// N; the weight of a kilogram under standard gravity, exact by definition.
const KILOGRAM_FORCE: f64 = 9.80665;
/// N; exact: the international pound is 0.45359237 kg.
const POUND_FORCE: f64 = 4.448_221_615_260_5;
/// Inches per metre; an inch is exactly 25.4 mm.
const PER_INCH: f64 = 1.0 / 25.4e-3;
/// Minutes per second.
const PER_MINUTE: f64 = 1.0 / 60.0;

impl Quantity {
    /// All quantities; the index of each is its number.
    pub const ALL: [Self; 4] = [Self::Time, Self::Position, Self::Force, Self::Velocity];

    /// Its name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Time => "time",
            Self::Position => "position",
            Self::Force => "force",
            Self::Velocity => "velocity",
        }
    }

    fn words(self) -> &'static [&'static str] {
        match self {
            Self::Time => &["time", "t", "timestamp", "elapsed", "stamp"],
            Self::Position => &["position", "pos", "x", "displacement", "insertion", "depth"],
            Self::Force => &["force", "f", "load", "friction"],
            Self::Velocity => &["velocity", "vel", "v"],
        }
    }

    /// The SI unit comes first; of several names of one unit, the one for messages.
    fn units(self) -> &'static [Unit] {
        match self {
            Self::Time => &[
                ("s", 1.0),
                ("ms", 1e3),
                ("us", 1e6),
                ("ns", 1e9),
                ("min", PER_MINUTE),
                ("sec", 1.0),
                ("second", 1.0),
                ("seconds", 1.0),
                ("msec", 1e3),
                ("usec", 1e6),
                ("nsec", 1e9),
                ("minutes", PER_MINUTE),
            ],
            Self::Position => &[
                ("m", 1.0),
                ("mm", 1e3),
                ("cm", 1e2),
                ("um", 1e6),
                ("in", PER_INCH),
                ("inch", PER_INCH),
                ("inches", PER_INCH),
            ],
            Self::Force => &[
                ("n", 1.0),
                ("mn", 1e3),
                ("kn", 1e-3),
                ("gf", 1e3 / KILOGRAM_FORCE),
                ("kgf", 1.0 / KILOGRAM_FORCE),
                ("lbf", 1.0 / POUND_FORCE),
                ("ozf", 16.0 / POUND_FORCE),
                ("g", 1e3 / KILOGRAM_FORCE),
                ("kg", 1.0 / KILOGRAM_FORCE),
                ("lb", 1.0 / POUND_FORCE),
                ("lbs", 1.0 / POUND_FORCE),
                ("newton", 1.0),
                ("newtons", 1.0),
            ],
            Self::Velocity => {
                &[("m_s", 1.0), ("mm_s", 1e3), ("cm_s", 1e2), ("um_s", 1e6), ("in_s", PER_INCH)]
            }
        }
    }

    /// All units, each by one of its names.
    pub(crate) fn unit_list(self) -> String {
        let units = self.units();
        let first = |k: &usize| units[..*k].iter().all(|(_, per_si)| *per_si != units[*k].1);
        let names: Vec<&str> = (0..units.len()).filter(first).map(|k| units[k].0).collect();
        names.join(", ")
    }

    /// Name of the unit with this number per SI unit.
    pub(crate) fn unit_of(self, per_si: f64) -> Option<&'static str> {
        self.units().iter().find(|(_, own)| *own == per_si).map(|(name, _)| *name)
    }

    /// A recognised name, for messages.
    pub(crate) fn example(self) -> &'static str {
        match self {
            Self::Time => "time_s",
            Self::Position => "position_mm",
            Self::Force => "force_n",
            Self::Velocity => "velocity_m_s",
        }
    }
}

/// Interpretation of a single name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reading {
    pub(crate) quantity: Quantity,
    /// The name is exactly the quantity's word.
    pub(crate) exact: bool,
    /// Number of the column's units per SI unit.
    pub(crate) per_si: Option<f64>,
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

/// Words of a name, in lower case.
fn words_of(lower: &str) -> Vec<&str> {
    lower
        .split(|c: char| !c.is_alphanumeric())
        .filter(|word| !word.is_empty() && *word != "per")
        .collect()
}

/// A name in lower case, with one sign for micro.
fn lower(name: &str) -> String {
    name.to_lowercase().replace(['µ', 'μ'], "u")
}

/// Whether a name denotes a quantity that is not measured, such as a setpoint.
pub(crate) fn is_related(name: &str) -> bool {
    words_of(&lower(name)).iter().any(|word| NOT_MEASURED.contains(word))
}

/// Units of angles.
const ANGLES: [&str; 13] = [
    "deg", "degs", "degree", "degrees", "grad", "rad", "rads", "radian", "radians", "mrad", "rev",
    "revs", "turns",
];

/// Whether the unit of a column, declared or at the end of its name, is that of an angle: no
/// position along the instrument, whatever the name says.
pub(crate) fn is_angle(name: &str, declared: &str) -> bool {
    let (own, declared) = (lower(name), lower(declared));
    let has_unit = |text: &str| {
        text.contains('°') || words_of(text).last().is_some_and(|word| ANGLES.contains(word))
    };
    // Without a unit in the name the declared one counts; `deg/s` and `N m/rad` are no angles.
    let unit_of_name = |text: &str| !text.contains(['/', '·', '^']) || text.contains('°');
    let is_alone = |text: &str| words_of(text).len() == 1 || text.contains('°');
    (has_unit(&own) && unit_of_name(&own) && !own.ends_with("c)") && !own.contains("°c"))
        || (is_alone(&declared) && has_unit(&declared) && !declared.contains("°c"))
}

/// Why a column of angles is refused.
pub(crate) const AN_ANGLE: &str = "is an angle, expected a position in m, mm, cm, um or in";

/// The remedy for a column of angles.
pub(crate) const CONVERT_ANGLE: &str = "convert the angle before: position_m = lever_arm_m * angle_rad with 1 deg = 0.0174533 rad; \
     the lever arm of a spindle is its lead / (2 pi)";

/// Units that are also something else: a mass, a minimum, an inlet.
const WEAK_UNITS: [&str; 6] = ["g", "kg", "lb", "lbs", "min", "in"];

/// The quantity that a name without any of its words denotes by its unit alone, as `Weg [mm]` or
/// `Fz_n`, and the number of units per SI unit. Never a velocity.
pub(crate) fn unit_alone(name: &str, declared: &str) -> Option<(Quantity, f64)> {
    let lower = lower(name);
    let words = words_of(&lower);
    let named = |word: &&str| Quantity::ALL.iter().any(|quantity| quantity.words().contains(word));
    if is_related(name) || words.iter().any(named) {
        return None;
    }
    let bracket =
        lower.trim_end().strip_suffix([']', ')']).and_then(|front| front.rsplit_once(['[', '(']));
    let unit = match bracket {
        Some((_, unit)) => words_of(unit).join("_"),
        None if !declared.is_empty() => words_of(&self::lower(declared)).join("_"),
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
    let mut found =
        units_named(&unit).filter(|_| !matches!(unit.as_str(), "g" | "kg" | "lb" | "lbs"));
    found.next().filter(|(quantity, _)| *quantity != Quantity::Velocity)
}

/// All quantities that have a unit of this name, with the number of units per SI unit.
fn units_named(unit: &str) -> impl Iterator<Item = (Quantity, f64)> {
    let of = move |quantity: Quantity| {
        let own = quantity.units().iter().find(|(name, _)| *name == unit);
        own.map(|(_, per_si)| (quantity, *per_si))
    };
    Quantity::ALL.into_iter().filter_map(of)
}

/// Recognises `force_N`, `Position (mm)`, `time [s]`, `t_ms`, `velocity m/s`.
fn recognise(name: &str) -> Option<Reading> {
    let lower = lower(name);
    let mut words = words_of(&lower);
    // `X_Value` is the time in LabVIEW's files.
    if words.iter().any(|word| NOT_MEASURED.contains(word)) || words[..] == ["x", "value"] {
        return None;
    }
    let quantity = quantity_of(&words)?;
    let per_si = take_unit(&mut words, quantity);
    // A stamp is a time, but a column that is called time comes first.
    let exact = words.len() == 1 && words[0] != "stamp";
    Some(Reading { quantity, exact, per_si })
}

/// Interpretation of a name together with its declared unit; the unit in the name takes precedence.
pub(crate) fn reading_with(name: &str, unit: &str, notes: &mut Vec<String>) -> Option<Reading> {
    let own = recognise(name);
    if unit.is_empty() || own.is_none() {
        return own;
    }
    let declared = recognise(&format!("{name} {unit}"));
    match own.and_then(|own| own.per_si) {
        None => declared,
        Some(per_si) => {
            let word = own.map_or("", |own| own.quantity.words()[0]);
            let other = recognise(&format!("{word} {unit}")).and_then(|declared| declared.per_si);
            if other != Some(per_si) {
                notes.push(format!(
                    "column '{name}' is declared in {unit}: the unit in its name is taken"
                ));
            }
            own
        }
    }
}

/// The quantity whose word the name contains; `None` for two different ones.
fn quantity_of(words: &[&str]) -> Option<Quantity> {
    let mut found = Quantity::ALL.into_iter().filter(|q| {
        // The first word counts as itself even if it could be a unit, as in `t_ms`.
        words.iter().any(|word| q.words().contains(word))
    });
    let first = found.next()?;
    found.next().is_none().then_some(first)
}

fn take_unit(words: &mut Vec<&str>, quantity: Quantity) -> Option<f64> {
    // `m·s^-1` leaves a single 1.
    if words.len() > 2 && words.last() == Some(&"1") {
        words.pop();
    }
    let parts = if quantity == Quantity::Velocity { 2 } else { 1 };
    let at = words.len().checked_sub(parts).filter(|&at| at > 0)?;
    let unit = words[at..].join("_");
    let per_si = quantity.units().iter().find(|(name, _)| *name == unit)?.1;
    words.truncate(at);
    Some(per_si)
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
    /// Rows per second, if times are not in the file.
    pub(crate) rate_hz: Option<f64>,
    /// The first time in ns since 1970, if times are timestamps in text.
    pub(crate) origin: Option<i64>,
}

impl Layout {
    pub(crate) fn has(&self, quantity: Quantity) -> bool {
        (quantity == Quantity::Time && self.rate_hz.is_some())
            || self.slots.iter().flatten().any(|slot| slot.is(quantity))
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
        let of = |quantity: Quantity| {
            let mut own = self.slots.iter().enumerate();
            let (k, slot) =
                own.find_map(|(k, slot)| Some((k, slot.filter(|slot| slot.is(quantity))?)))?;
            entry(quantity, slot.per_si, &numbered(&self.names, k))
        };
        Quantity::ALL.into_iter().filter_map(of).collect()
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
        let is_position = |word: &&str| {
            let quantity = recognise(word.split('=').next().unwrap_or_default());
            quantity.is_some_and(|reading| reading.quantity == Quantity::Position)
        };
        if let Some(in_order) = given.filter(|given| !given.contains('=')) {
            let turn = |word: &str| match word.trim().strip_prefix('-') {
                Some(front) if is_position(&front) => front.to_owned(),
                None if is_position(&word) => format!("-{}", word.trim()),
                _ => word.to_owned(),
            };
            return Some(in_order.split(',').map(turn).collect::<Vec<_>>().join(","));
        }
        let mut turned = self.clone();
        let slots = turned.slots.iter_mut().flatten();
        slots
            .filter(|slot| slot.is(Quantity::Position))
            .for_each(|slot| slot.per_si = -slot.per_si);
        let mut words = turned.words();
        if given.is_none() {
            words.retain(|word| is_position(&&**word));
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
        let layout = Self { names, slots, source: "--columns", ..Self::default() };
        for quantity in Quantity::ALL {
            let mut taken = layout.slots.iter().flatten().filter(|slot| slot.is(quantity));
            let count = taken.by_ref().count();
            if count > 1 || (count == 0 && needed.contains(&quantity)) {
                let problem = format!("naming {} {count} times, expected once", quantity.name());
                return Err(RecordingError::BadColumns { entry: mapping.to_owned(), problem });
            }
        }
        Ok(layout)
    }
}

/// An entry of `--columns`, such as `force_mn=-load`; a negative `per_si` reverses the sign. `None`
/// if there is no such unit.
pub(crate) fn entry(quantity: Quantity, per_si: f64, name: &str) -> Option<String> {
    let unit = quantity.unit_of(per_si.abs())?;
    let plain = !name.contains(',') && !name.starts_with(['-', '"']) && name.trim() == name;
    let name = if plain { name.to_owned() } else { format!("\"{name}\"") };
    Some(format!("{}_{unit}={}{name}", quantity.name(), if per_si < 0.0 { "-" } else { "" }))
}

/// A column of a table that is not a file: its index, from 0, and the number of its units per SI
/// unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableColumn {
    /// Index among the names.
    pub index: usize,
    /// Divisor for conversion to SI.
    pub per_si: f64,
}

/// Which columns of a table are which quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct TableColumns {
    /// Time, position and force, in this order.
    pub needed: [TableColumn; 3],
    /// Velocity, if there is one.
    pub velocity: Option<TableColumn>,
    /// Assumptions made.
    pub notes: Vec<String>,
}

impl TableColumns {
    /// Finds the columns of `table` by their `names`, with the same rules as for the header of a
    /// file, or by `mapping` (`time_s,position_mm,-,force_n`) in their order.
    ///
    /// # Errors
    /// [`RecordingError`] if a column or its unit is missing or ambiguous.
    pub fn find(
        table: &str,
        names: &[String],
        mapping: Option<&str>,
    ) -> Result<Self, RecordingError> {
        Self::find_with_units(table, names, &[], &[], mapping)
    }

    /// The same with the units declared for the names, empty if there are none, and the indices of
    /// the columns that hold timestamps, which count in s.
    ///
    /// # Errors
    /// As for [`TableColumns::find`].
    pub fn find_with_units(
        table: &str,
        names: &[String],
        units: &[String],
        timestamps: &[usize],
        mapping: Option<&str>,
    ) -> Result<Self, RecordingError> {
        let needed = [Quantity::Time, Quantity::Position, Quantity::Force];
        let layout = match mapping {
            Some(mapping) if !mapping.contains('=') => Layout::from_mapping(mapping, &needed)?,
            mapping => {
                let given = mapping.map_or(Ok(Vec::new()), Given::parse)?;
                let header = Header {
                    file: table,
                    place: "",
                    names,
                    units,
                    timestamps,
                    first_rows: &Vec::new,
                    first_text: &|_| None,
                };
                header.layout(&given, &needed)?
            }
        };
        if layout.slots.len() != names.len() {
            let problem =
                format!("for {} columns, but {table} has {}", layout.slots.len(), names.len());
            return Err(RecordingError::BadColumns {
                entry: mapping.unwrap_or_default().to_owned(),
                problem,
            });
        }
        let of = |quantity: Quantity| {
            let slots = layout.slots.iter().enumerate();
            let mut own =
                slots.filter_map(|(index, slot)| Some((index, slot.filter(|s| s.is(quantity))?)));
            own.next().map(|(index, slot)| TableColumn { index, per_si: slot.per_si })
        };
        let found = needed.map(|quantity| of(quantity).expect("the layout holds what is needed"));
        Ok(Self { needed: found, velocity: of(Quantity::Velocity), notes: layout.notes })
    }
}

fn mapped_slot(name: &str) -> Result<Option<Slot>, RecordingError> {
    if matches!(name, "-" | "skip" | "") {
        return Ok(None);
    }
    let bad = |problem: String| RecordingError::BadColumns { entry: name.to_owned(), problem };
    let (name, reversed) = match name.strip_prefix('-') {
        Some(front) => (front.trim(), true),
        None => (name, false),
    };
    if is_angle(name, "") {
        return Err(bad(format!(
            "an angle, expected a position in m, mm, cm, um or in: {CONVERT_ANGLE}"
        )));
    }
    let reading = recognise(name)
        .ok_or_else(|| bad("not understood, expected time, position, force or velocity".into()))?;
    let per_si = reading.per_si.ok_or_else(|| {
        bad(format!("without a unit, expected one of {}", reading.quantity.unit_list()))
    })?;
    Ok(Some(Slot::of(reading.quantity, if reversed { -per_si } else { per_si })))
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
                quoted =
                    front.is_some_and(|front| front.chars().all(|c| c == '-' || c.is_whitespace()));
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
        return Err(RecordingError::BadColumns { entry: entry.to_owned(), problem });
    }
    found.push(entry);
    Ok(found)
}

/// An entry `force_n=-fz` of `--columns`: a quantity, and the name of its column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Given {
    pub(crate) quantity: Quantity,
    /// Unit declared in the entry; otherwise the column's own name must give it.
    per_si: Option<f64>,
    pub(crate) column: String,
    reversed: bool,
}

/// The name of a column, followed by `#` and its number among those of the same name if there are
/// several.
pub(crate) fn numbered(names: &[String], index: usize) -> String {
    let name = &names[index];
    let same = |own: &&String| *own == name;
    match names.iter().filter(same).count() {
        1 => name.clone(),
        _ => format!("{name}#{}", names[..index].iter().filter(same).count() + 1),
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
                return Err(RecordingError::BadColumns { entry: mapping.to_owned(), problem });
            }
        }
        Ok(given)
    }

    fn parse_one(entry: &str) -> Result<Self, RecordingError> {
        let bad = |problem: &str| RecordingError::BadColumns {
            entry: entry.to_owned(),
            problem: problem.to_owned(),
        };
        let (what, column) = entry
            .split_once('=')
            .ok_or_else(|| bad("without '=', while others have one: name all by column"))?;
        let reading = recognise(what).ok_or_else(|| {
            bad("not understood, expected time, position, force or velocity in front of '='")
        })?;
        if reading.per_si.is_none() && !reading.exact {
            let units = reading.quantity.unit_list();
            return Err(bad(&format!("in a unit that is not understood, expected one of {units}")));
        }
        let column = column.trim();
        let reversed = column.starts_with('-');
        let column = column.trim_start_matches('-').trim();
        let unquoted = column.strip_prefix('"').and_then(|column| column.strip_suffix('"'));
        let column = unquoted.unwrap_or(column).to_owned();
        if column.is_empty() {
            return Err(bad("without the name of a column behind '='"));
        }
        Ok(Self { quantity: reading.quantity, per_si: reading.per_si, column, reversed })
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
            if let (true, Some(index)) = (all.len() > 1, all.get(number.wrapping_sub(1))) {
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
            return Err(RecordingError::BadColumns { entry: self.column.clone(), problem });
        }
        let mut like = (0..names.len()).filter(|k| names[*k].eq_ignore_ascii_case(&self.column));
        match (like.next(), like.next()) {
            (Some(index), None) => Ok(index),
            _ => {
                let problem =
                    format!("a name that no column has, expected one of {}", listed(names));
                Err(RecordingError::BadColumns { entry: self.column.clone(), problem })
            }
        }
    }

    /// Rejects a column of angles, with its declared unit, as a position.
    pub(crate) fn check_angle(&self, name: &str, declared: &str) -> Result<(), RecordingError> {
        if self.quantity != Quantity::Position || !is_angle(name, declared) {
            return Ok(());
        }
        let problem =
            format!("an angle, expected a position in m, mm, cm, um or in: {CONVERT_ANGLE}");
        Err(RecordingError::BadColumns { entry: format!("position={name}"), problem })
    }

    /// Slot with the unit of the entry, otherwise with that of `name`.
    pub(crate) fn slot_for(&self, name: &str) -> Result<Slot, RecordingError> {
        self.slot(recognise(name))
    }

    pub(crate) fn slot(&self, own: Option<Reading>) -> Result<Slot, RecordingError> {
        let declared = own.filter(|own| own.quantity == self.quantity).and_then(|own| own.per_si);
        let per_si = self.per_si.or(declared).ok_or_else(|| {
            let units = self.quantity.unit_list();
            let problem = format!(
                "{} without a unit, and the column's name has none either, expected one of {units}",
                self.quantity.name()
            );
            RecordingError::BadColumns {
                entry: format!("{}={}", self.quantity.name(), self.column),
                problem,
            }
        })?;
        Ok(Slot::of(self.quantity, if self.reversed { -per_si } else { per_si }))
    }
}

/// Names for a message, the first few of many.
pub(crate) fn listed(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let shown = names.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN { format!("{shown}, ... ({} in all)", names.len()) } else { shown }
}

/// The quantity denoted by a name with an SI unit, and the unit.
pub(crate) fn si_quantity(name: &str) -> Option<(Quantity, &'static str)> {
    let reading = recognise(name).filter(|reading| reading.per_si == Some(1.0))?;
    Some((reading.quantity, reading.quantity.units()[0].0))
}

/// The unit at the end of a name that denotes one of the quantities.
pub fn unit_in(name: &str) -> Option<&'static str> {
    let reading = recognise(name)?;
    let per_si = reading.per_si?;
    let unit = reading.quantity.unit_of(per_si)?;
    Some(match unit {
        "n" => "N",
        "mn" => "mN",
        "kn" => "kN",
        "m_s" => "m/s",
        "mm_s" => "mm/s",
        "cm_s" => "cm/s",
        "um_s" => "um/s",
        "in_s" => "in/s",
        other => other,
    })
}

/// Units per second of a column of times, if known; `None` if it is not a column of times.
pub fn time_unit(name: &str, unit: Option<&str>) -> Option<Option<f64>> {
    let reading = recognise(&format!("{name} {}", unit.unwrap_or_default()))?;
    (reading.quantity == Quantity::Time).then_some(reading.per_si)
}

/// The quantity that a name denotes.
pub(crate) fn quantity_named(name: &str) -> Option<Quantity> {
    recognise(name).map(|reading| reading.quantity)
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
            && units_named(&words_of(&lower(unit)).join("_")).next().is_some()
    })
}

/// Whether every cell is only a unit, as in the second header line of some loggers.
pub(crate) fn is_unit_row(cells: &[String]) -> bool {
    let is_unit = |cell: &&String| units_named(&words_of(&lower(cell)).join("_")).next().is_some();
    cells.iter().filter(is_unit).count() >= 2
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
        ] {
            assert_eq!(reading(name), Some((quantity, true, Some(per_si))), "{name}");
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
            assert!(is_angle(name, declared), "{name} {declared}");
        }
        for (name, declared) in [
            ("position_mm", ""),
            ("radius_mm", ""),
            ("temperature (°C)", ""),
            ("velocity_deg/s", ""),
            ("stiffness", "N m/rad"),
            ("position", "mm"),
        ] {
            assert!(!is_angle(name, declared), "{name} {declared}");
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
        assert_eq!(reading("force_dyn"), Some((Quantity::Force, false, None)));
        assert_eq!(reading("position (ft)"), Some((Quantity::Position, false, None)));
        assert_eq!(reading("position_kg"), Some((Quantity::Position, false, None)));
        assert_eq!(reading("stamp_ticks"), Some((Quantity::Time, false, None)));
        assert_eq!(reading("stamp_ns"), Some((Quantity::Time, false, Some(1e9))));
        assert_eq!(reading("force"), Some((Quantity::Force, true, None)));
        assert_eq!(reading("motor_position_mm"), Some((Quantity::Position, false, Some(1e3))));
    }
}
