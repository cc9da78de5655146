//! The one table of units: those that each quantity is read in, and those of other quantities,
//! with what to do about a column of them.

/// Quantities that a column can hold, as the table below declares them.
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
    /// Angle of the instrument about its axis, in rad. Never taken without a unit.
    Angle,
    /// Torque of the instrument on the seal about its axis, in N·m, positive with the angle. Never
    /// taken without a unit.
    Torque,
    /// Force that presses the instrument against the wall of its cannula, in N. Never taken without a unit.
    SideForce,
    /// Angle between the direction of insertion and straight down, in rad. Never taken without a unit.
    Tilt,
    /// Pressure of the gas above that of the room, in Pa. Never taken without a unit.
    Pressure,
}

struct Declaration {
    quantity: Quantity,
    name: &'static str,
    with_article: &'static str,
    words: &'static [&'static str],
    /// A recognised name.
    example: &'static str,
    /// The SI unit comes first.
    units: &'static [Unit],
}

const QUANTITIES: [Declaration; 9] = [
    Declaration {
        quantity: Quantity::Time,
        name: "time",
        with_article: "a time",
        words: &["time", "t", "timestamp", "elapsed", "stamp"],
        example: "time_s",
        units: &TIMES,
    },
    Declaration {
        quantity: Quantity::Position,
        name: "position",
        with_article: "a position",
        words: &["position", "pos", "x", "displacement", "insertion", "depth"],
        example: "position_mm",
        units: &POSITIONS,
    },
    Declaration {
        quantity: Quantity::Force,
        name: "force",
        with_article: "a force",
        words: &["force", "f", "load", "friction"],
        example: "force_n",
        units: &FORCES,
    },
    Declaration {
        quantity: Quantity::Velocity,
        name: "velocity",
        with_article: "a velocity",
        words: &["velocity", "vel", "v"],
        example: "velocity_m_s",
        units: &VELOCITIES,
    },
    Declaration {
        quantity: Quantity::Angle,
        name: "angle",
        with_article: "an angle",
        words: &["angle", "roll"],
        example: "angle_deg",
        units: &ANGLES,
    },
    Declaration {
        quantity: Quantity::Torque,
        name: "torque",
        with_article: "a torque",
        words: &["torque", "moment"],
        example: "torque_n_m",
        units: &TORQUES,
    },
    Declaration {
        quantity: Quantity::SideForce,
        name: "side force",
        with_article: "a side force",
        words: &["side", "lateral"],
        example: "side_force_n",
        units: &FORCES,
    },
    Declaration {
        quantity: Quantity::Tilt,
        name: "tilt",
        with_article: "a tilt",
        words: &["tilt"],
        example: "tilt_deg",
        units: &ANGLES,
    },
    Declaration {
        quantity: Quantity::Pressure,
        name: "pressure",
        with_article: "a pressure",
        words: &["pressure"],
        example: "pressure_pa",
        units: &PRESSURES,
    },
];

impl Quantity {
    /// All quantities; the index of each is its number.
    pub const ALL: [Self; QUANTITIES.len()] = {
        let mut all = [Self::Time; QUANTITIES.len()];
        let mut k = 0;
        while k < all.len() {
            all[k] = QUANTITIES[k].quantity;
            k += 1;
        }
        all
    };
    /// Those that every recording has.
    pub(crate) const NEEDED: [Self; 3] = [Self::Time, Self::Position, Self::Force];

    fn declaration(self) -> &'static Declaration {
        &QUANTITIES[self as usize]
    }

    /// Whether a column is it only with a unit: a torque without one may be an effort in per cent.
    pub(crate) fn needs_unit(self) -> bool {
        !Self::NEEDED.contains(&self) && self != Self::Velocity
    }

    /// Its name in messages.
    pub fn name(self) -> &'static str {
        self.declaration().name
    }

    pub(crate) fn words(self) -> &'static [&'static str] {
        self.declaration().words
    }

    /// Its name with an article, in messages.
    pub(crate) fn with_article(self) -> &'static str {
        self.declaration().with_article
    }

    /// The name of a column of it in a unit.
    pub(crate) fn column_in(self, unit: &str) -> String {
        format!("{}_{unit}", self.name().replace(' ', "_"))
    }

    /// The same in SI units.
    pub(crate) fn column_name(self) -> String {
        self.column_in(self.units()[0].names[0])
    }

    /// A recognised name, for messages.
    pub(crate) fn example(self) -> &'static str {
        self.declaration().example
    }
}

/// A unit of a quantity.
pub(crate) struct Unit {
    /// As messages write it.
    pub(crate) symbol: &'static str,
    /// As names write it, prepared by [`lower`] and joined by `_`; the first is that of `--columns`.
    names: &'static [&'static str],
    /// Number of these units per SI unit.
    pub(crate) per_si: f64,
}

const fn unit(symbol: &'static str, names: &'static [&'static str], per_si: f64) -> Unit {
    Unit { symbol, names, per_si }
}

/// N; the weight of a kilogram under standard gravity, exact by definition.
const KILOGRAM_FORCE: f64 = 9.80665;
/// N; exact: the international pound is 0.45359237 kg.
const POUND_FORCE: f64 = 4.448_221_615_260_5;
/// Inches per metre; an inch is exactly 25.4 mm.
const PER_INCH: f64 = 1.0 / 25.4e-3;
/// Feet per metre; a foot is exactly 12 inches.
const PER_FOOT: f64 = 1.0 / 304.8e-3;
/// Minutes and hours per second.
const PER_MINUTE: f64 = 1.0 / 60.0;
const PER_HOUR: f64 = 1.0 / 3600.0;

const TIMES: [Unit; 6] = [
    unit("s", &["s", "sec", "secs", "second", "seconds", "sek", "sekunden"], 1.0),
    unit("ms", &["ms", "msec", "millisecond", "milliseconds"], 1e3),
    unit("us", &["us", "usec", "microsecond", "microseconds"], 1e6),
    unit("ns", &["ns", "nsec", "nanosecond", "nanoseconds"], 1e9),
    unit("min", &["min", "minute", "minutes", "minuten"], PER_MINUTE),
    unit("h", &["h", "hr", "hrs", "hour", "hours", "stunden"], PER_HOUR),
];

const POSITIONS: [Unit; 9] = [
    unit("m", &["m", "metre", "metres", "meter", "meters"], 1.0),
    unit("mm", &["mm", "millimetre", "millimetres", "millimeter", "millimeters"], 1e3),
    unit("cm", &["cm", "centimetre", "centimetres", "centimeter", "centimeters"], 1e2),
    unit("um", &["um", "micron", "microns", "micrometre", "micrometer"], 1e6),
    unit("nm", &["nm", "nanometre", "nanometer"], 1e9),
    unit("dm", &["dm"], 10.0),
    unit("in", &["in", "inch", "inches"], PER_INCH),
    unit("ft", &["ft", "foot", "feet"], PER_FOOT),
    unit("mil", &["mil", "mils", "thou"], 1e3 * PER_INCH),
];

const FORCES: [Unit; 13] = [
    unit("N", &["n", "newton", "newtons"], 1.0),
    unit("mN", &["mn", "millinewton", "millinewtons"], 1e3),
    unit("uN", &["un", "micronewton", "micronewtons"], 1e6),
    unit("cN", &["cn", "centinewton", "centinewtons"], 1e2),
    unit("daN", &["dan", "decanewton", "decanewtons"], 0.1),
    unit("kN", &["kn", "kilonewton", "kilonewtons"], 1e-3),
    unit("dyn", &["dyn", "dyne", "dynes"], 1e5),
    unit("gf", &["gf", "g", "pond", "gram", "grams", "grf"], 1e3 / KILOGRAM_FORCE),
    unit("kgf", &["kgf", "kg"], 1.0 / KILOGRAM_FORCE),
    unit("kp", &["kp", "kilopond"], 1.0 / KILOGRAM_FORCE),
    unit("lbf", &["lbf", "lb", "lbs", "pound", "pounds"], 1.0 / POUND_FORCE),
    unit("ozf", &["ozf", "oz"], 16.0 / POUND_FORCE),
    unit("pdl", &["pdl", "poundal"], 1.0 / 0.138_254_954_376),
];

const VELOCITIES: [Unit; 7] = [
    unit("m/s", &["m_s"], 1.0),
    unit("mm/s", &["mm_s"], 1e3),
    unit("cm/s", &["cm_s"], 1e2),
    unit("um/s", &["um_s"], 1e6),
    unit("in/s", &["in_s"], PER_INCH),
    unit("ft/s", &["ft_s"], PER_FOOT),
    unit("mm/min", &["mm_min"], 1e3 / PER_MINUTE),
];

const ANGLES: [Unit; 4] = [
    unit("rad", &["rad", "rads", "radian", "radians"], 1.0),
    unit("deg", &["deg", "degs", "degree", "degrees"], 180.0 / std::f64::consts::PI),
    unit("turns", &["turns", "turn", "rev", "revs"], 0.5 / std::f64::consts::PI),
    unit("mrad", &["mrad"], 1e3),
];

const TORQUES: [Unit; 4] = [
    unit("N m", &["n_m", "Nm", "nm"], 1.0),
    unit("mN m", &["mn_m", "mnm"], 1e3),
    unit("N mm", &["n_mm", "nmm"], 1e3),
    unit("N cm", &["n_cm", "ncm"], 1e2),
];

const PRESSURES: [Unit; 8] = [
    unit("Pa", &["pa"], 1.0),
    unit("hPa", &["hpa"], 1e-2),
    unit("kPa", &["kpa"], 1e-3),
    unit("MPa", &["mpa"], 1e-6),
    unit("bar", &["bar"], 1e-5),
    unit("mbar", &["mbar"], 1e-2),
    unit("psi", &["psi"], 1.0 / 6_894.757_293_168),
    unit("mmHg", &["mmhg"], 1.0 / 133.322_387_415),
];

impl Quantity {
    /// The SI unit comes first.
    pub(crate) fn units(self) -> &'static [Unit] {
        self.declaration().units
    }

    /// The unit of this name, as by [`key`].
    pub(crate) fn unit(self, name: &str) -> Option<&'static Unit> {
        self.units().iter().find(|unit| unit.names.contains(&name))
    }

    /// Units per SI unit of a unit that is declared, if it is one of this quantity.
    pub(crate) fn declared(self, unit: &str) -> Option<f64> {
        self.unit(&key(&lower(unit))).map(|unit| unit.per_si)
    }

    /// All units, for messages.
    pub(crate) fn unit_list(self) -> String {
        self.units().iter().map(|unit| unit.symbol).collect::<Vec<_>>().join(", ")
    }

    /// In `--columns`, the name of the unit with this number per SI unit.
    pub(crate) fn unit_of(self, per_si: f64) -> Option<&'static str> {
        self.units().iter().find(|unit| unit.per_si == per_si).map(|unit| unit.names[0])
    }
}

/// A quantity that stands in the place of another, known by its units.
pub(crate) struct Foreign {
    /// In messages, with its article.
    pub(crate) what: &'static str,
    units: &'static [&'static str],
    /// The same quantity where it is read in a column of its own.
    pub(crate) own: Option<Quantity>,
    /// The quantities that are recorded in its place.
    pub(crate) instead_of: &'static [Quantity],
    /// What to do with a column of it.
    pub(crate) remedy: &'static str,
}

impl Foreign {
    /// Why a column of it is not read, and what to do.
    pub(crate) fn refused(&self, quantity: Quantity) -> String {
        format!(
            "{}, expected {} in {}: {}",
            self.what,
            quantity.with_article(),
            quantity.unit_list(),
            self.remedy
        )
    }
}

const FOREIGN: [Foreign; 6] = [
    Foreign {
        what: "an angle",
        units: &[
            "deg", "degs", "degree", "degrees", "grad", "rad", "rads", "radian", "radians", "mrad",
            "rev", "revs", "turn", "turns",
        ],
        own: Some(Quantity::Angle),
        instead_of: &[Quantity::Position],
        remedy: "multiply the angle by its lever arm, as in position_mm=12.5*phi for 12.5 mm per radian \
                 (1 deg = 0.0174533 rad); the lever arm of a spindle is its lead / (2 pi)",
    },
    Foreign {
        what: "a voltage",
        units: &["v", "mv", "uv", "volt", "volts", "millivolt", "millivolts", "mv_v"],
        own: None,
        instead_of: &[Quantity::Force, Quantity::Position],
        remedy: "multiply the voltage by the sensor's calibration, as in force_n=22.2*U for 22.2 N/V",
    },
    Foreign {
        what: "a current",
        units: &["a", "ma", "amp", "amps", "ampere"],
        own: None,
        instead_of: &[Quantity::Force],
        remedy: "multiply the current by the motor's force per ampere, as in force_n=4.5*I for 4.5 N/A; better, use a force sensor",
    },
    Foreign {
        what: "a pressure",
        units: &["pa", "hpa", "kpa", "mpa", "bar", "mbar", "psi", "mmhg"],
        own: Some(Quantity::Pressure),
        instead_of: &[Quantity::Force],
        remedy: "multiply the pressure by the area on which it acts, as in force_n=0.08*p for kPa on 80 mm^2",
    },
    Foreign {
        what: "a torque",
        units: &["Nm", "n_m", "mn_m", "mnm", "nmm", "n_mm", "ncm", "n_cm"],
        own: Some(Quantity::Torque),
        instead_of: &[Quantity::Force],
        remedy: "divide the torque by its lever arm, as in force_n=40*M for N m at 25 mm",
    },
    Foreign {
        what: "a count",
        units: &[
            "count",
            "counts",
            "cts",
            "tick",
            "ticks",
            "pulse",
            "pulses",
            "steps",
            "lsb",
            "digits",
            "increment",
            "increments",
            "incr",
        ],
        own: None,
        instead_of: &[Quantity::Position, Quantity::Force, Quantity::Time],
        remedy: "multiply the counts by what one of them stands for, as in position_mm=0.004*counts for 4 µm a count",
    },
];

/// A name in lower case, with one sign for micro and words for degrees. `Nm` and `MN`, which differ
/// from `nm` and `mN` only by case, are kept.
pub(crate) fn lower(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for part in name.split_inclusive(|c: char| !c.is_alphanumeric()) {
        let word = part.trim_end_matches(|c: char| !c.is_alphanumeric());
        match word {
            "Nm" | "MN" => text.push_str(part),
            _ => text.push_str(&part.to_lowercase()),
        }
    }
    // All that is replaced is beyond ASCII.
    if text.is_ascii() {
        return text;
    }
    text.replace(['µ', 'μ'], "u").replace("°c", "celsius").replace('°', " deg ")
}

/// Words of a name that was prepared by [`lower`].
pub(crate) fn words_of(lower: &str) -> Vec<&str> {
    lower
        .split(|c: char| !c.is_alphanumeric() && c != '\'')
        .filter(|word| !word.is_empty() && *word != "per")
        .collect()
}

/// A unit alone, prepared by [`lower`], as the tables have it.
pub(crate) fn key(unit: &str) -> String {
    let mut words = words_of(unit);
    // `m·s^-1` leaves a single 1.
    if words.len() > 2 && words.last() == Some(&"1") {
        words.pop();
    }
    words.join("_")
}

/// All quantities that have a unit of this [`key`], with the number of units per SI unit.
pub(crate) fn units_named(key: &str) -> impl Iterator<Item = (Quantity, f64)> {
    Quantity::ALL
        .into_iter()
        .filter_map(move |quantity| Some((quantity, quantity.unit(key)?.per_si)))
}

/// Whether a cell of a header is a unit and nothing else.
pub(crate) fn is_unit(cell: &str) -> bool {
    let key = key(&lower(cell));
    units_named(&key).next().is_some() || foreign_named(&key).is_some()
}

fn foreign_named(key: &str) -> Option<&'static Foreign> {
    FOREIGN.iter().find(|own| own.units.contains(&key))
}

/// A name prepared by [`lower`] in front of the brackets at its end, and what is in these.
pub(crate) fn bracketed(lower: &str) -> Option<(&str, &str)> {
    let inner = lower.trim_end().strip_suffix([']', ')', '}'])?;
    let (front, unit) = inner.rsplit_once(['[', '(', '{'])?;
    (!words_of(front).is_empty() && !unit.trim().is_empty()).then_some((front, unit))
}

/// The quantity that is not read, by the unit of a column, and whether that unit stands alone:
/// declared, in brackets or behind a slash.
pub(crate) fn foreign(name: &str, declared: &str) -> Option<(&'static Foreign, bool)> {
    let (lower, declared) = (lower(name), lower(declared));
    if let Some((_, unit)) = bracketed(&lower) {
        return foreign_named(&key(unit)).map(|own| (own, true));
    }
    if let Some(own) = foreign_named(&key(&declared)) {
        return Some((own, true));
    }
    if !declared.trim().is_empty() {
        return None;
    }
    let words = words_of(&lower);
    let [.., before, last] = words[..] else { return None };
    let is_alone = lower.trim_end().strip_suffix(last)?.trim_end().ends_with('/');
    // `N/V` is a calibration. `v` is a velocity, too, and `force_a` the force of channel a.
    let is_ratio = units_named(before).next().is_some();
    let is_letter = last.len() == 1 && !is_alone;
    let is_of_force = last == "v" && Quantity::Force.words().contains(&before);
    if is_ratio || (is_letter && !is_of_force) {
        return None;
    }
    // A length of 1e-9 m elsewhere.
    let is_torque = last == "nm" && words.contains(&"torque");
    foreign_named(if is_torque { "Nm" } else { last }).map(|own| (own, is_alone))
}
