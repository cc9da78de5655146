//! Selects the topics of a robot log that are position, velocity and force, and aligns them on one
//! clock.

use trocar_tables::content::{HEADER_STAMP, LOG_TIME};

use super::RecordingError;
use super::choice::{Choice, allowed};
use super::columns::{self, Given, Layout, Quantity, Slot, entry, reading_of};
use super::container::{Batches, Container, Table};
use super::crtk::{Candidate, Certainty, Meaning, axis_of_travel, estimate, meaning};
use super::header::likely_unit;
use super::join::{Pick, join};

/// Aligned topics, and the assumptions made.
pub(super) struct Chosen {
    pub(super) layout: Layout,
    pub(super) batches: Box<dyn Batches>,
    pub(super) warnings: Vec<String>,
}

/// A topic column used for a quantity.
struct Taken {
    quantity: Quantity,
    table: usize,
    column: usize,
    slot: Slot,
    /// The reason, unless the column was named by the user.
    why: Option<String>,
}

/// A column of a topic, and what it may be.
type Place = (usize, usize, Candidate);

/// A column that is proposed: table and column, and its units per SI unit.
type Proposal = ((usize, usize), f64);

/// How likely a candidate is: certainty, third joint, range.
type Rank = (Certainty, bool, f64);

/// Whether tables are topics of a log: they have log times.
pub(super) fn is_log(tables: &[Table]) -> bool {
    let mut columns = tables.iter().flat_map(|table| &table.columns);
    columns.any(|column| column.name == HEADER_STAMP || column.name == LOG_TIME)
}

/// Finds the quantities in the topics of `container` and aligns them to the times of the position.
pub(super) fn choose(
    file: &str,
    container: &Container,
    choice: &Choice,
    needed: &[Quantity],
) -> Result<Chosen, RecordingError> {
    if choice.rate_hz.is_some() {
        let problem =
            "‹rate_hz› is for a table without times, and this is a log with times of its own";
        return Err(RecordingError::unusable(file, problem));
    }
    let topics =
        Topics { file, container, allowed: allowed(file, &container.tables, &choice.topics)? };
    if let Some(mapping) = choice.in_order() {
        return Err(topics.in_order(mapping));
    }
    let given = choice.given()?;
    let (mut taken, mut unclear) = (Vec::new(), Vec::new());
    for quantity in [Quantity::Position, Quantity::Force, Quantity::Velocity] {
        let own = given.iter().find(|given| given.quantity == quantity);
        let position = taken.first().map(|taken: &Taken| taken.table);
        match own
            .map_or_else(|| topics.found(quantity, position), |own| topics.named(own).map(Ok))?
        {
            Ok(own) => taken.push(own),
            Err(candidates) if needed.contains(&quantity) => unclear.push((quantity, candidates)),
            Err(_) => {}
        }
    }
    if !unclear.is_empty() {
        return Err(topics.unclear(&given, &taken, &unclear)?);
    }
    for (k, own) in taken.iter().enumerate() {
        if taken[..k].iter().any(|other| (other.table, other.column) == (own.table, own.column)) {
            return Err(RecordingError::named_twice(&topics.name(own.table, own.column)));
        }
    }
    let clock = given
        .iter()
        .find(|given| given.quantity == Quantity::Time)
        .map(|given| topics.named(given));
    topics.joined(&taken, clock.transpose()?, &given)
}

struct Topics<'a> {
    file: &'a str,
    container: &'a Container,
    allowed: Vec<usize>,
}

impl Topics<'_> {
    fn in_order(&self, mapping: &str) -> RecordingError {
        let problem = "in order, but a log has topics: name each column by its topic and field";
        RecordingError::bad_columns(mapping, problem.to_owned())
    }

    /// `TOPIC.FIELD`.
    fn name(&self, table: usize, column: usize) -> String {
        let table = &self.container.tables[table];
        format!("{}.{}", table.name, table.columns[column].name)
    }

    /// All numeric columns of the topics to search.
    fn columns(&self) -> impl Iterator<Item = (usize, usize)> {
        self.allowed.iter().flat_map(|&table| {
            let columns = self.container.tables[table].columns.iter().enumerate();
            columns.filter(|(_, own)| own.is_numeric).map(move |(column, _)| (table, column))
        })
    }

    /// The names of these columns.
    fn names(&self) -> Vec<String> {
        self.columns().map(|(table, column)| self.name(table, column)).collect()
    }

    /// The column that `--columns` names: by topic and field, or by the field alone if only one
    /// topic has it.
    fn named(&self, given: &Given) -> Result<Taken, RecordingError> {
        let tables = &self.container.tables;
        let places: Vec<(usize, usize)> = self.columns().collect();
        let mut alone = (0..places.len()).filter(|k| {
            let (table, column) = places[*k];
            tables[table].columns[column].name == given.column
        });
        let index = match (given.find(&self.names()), alone.next(), alone.next()) {
            (Err(_), Some(index), None) => index,
            (found, ..) => found?,
        };
        let (table, column) = places[index];
        let quantity = given.quantity;
        let topic = &self.container.tables[table].columns[column];
        let declared = topic.unit.as_deref().unwrap_or_default();
        given.check_unit(&topic.name, declared)?;
        let own = self.candidate(table, column).filter(|own| own.quantity == quantity);
        let per_si = own.and_then(|own| own.per_si).or(quantity.declared(declared));
        Ok(Taken { quantity, table, column, slot: given.slot(per_si)?, why: None })
    }

    /// Meaning of a column according to names and types.
    fn candidate(&self, table: usize, column: usize) -> Option<Candidate> {
        let topics = &self.container.tables;
        let topic = &topics[table];
        match meaning(&topic.name, &topic.kind, &topic.columns[column].name) {
            Meaning::Candidate(mut own) => {
                let is_sensor =
                    own.quantity == Quantity::Force && own.certainty >= Certainty::Likely;
                let names = topics.iter().map(|topic| &*topic.name);
                if let Some(why) = is_sensor.then(|| estimate(&topic.name, names)).flatten() {
                    (own.certainty, own.why) = (Certainty::Estimated, why);
                }
                Some(own)
            }
            Meaning::Nothing => None,
            Meaning::Unknown => by_name(topic, column),
        }
    }

    /// All columns that may be a quantity.
    fn candidates(&self, quantity: Quantity) -> Vec<Place> {
        self.columns()
            .filter_map(|(table, column)| Some((table, column, self.candidate(table, column)?)))
            .filter(|(.., own)| own.quantity == quantity)
            .collect()
    }

    /// The column that is clearly a quantity, or else all that may be. Velocity is taken only from
    /// the topic of the position, and of forces that of the only sensor.
    fn found(
        &self,
        quantity: Quantity,
        position: Option<usize>,
    ) -> Result<Result<Taken, Vec<Place>>, RecordingError> {
        let mut candidates = self.candidates(quantity);
        match quantity {
            Quantity::Velocity => candidates.retain(|(table, _, candidate)| {
                Some(*table) == position && candidate.certainty == Certainty::Clear
            }),
            Quantity::Position => self.settle_axes(&mut candidates)?,
            _ => {}
        }
        let best = candidates.iter().map(|(.., own)| own.certainty).max();
        // One sensor is as good as another, whatever it is called.
        let least =
            if quantity == Quantity::Force { best.min(Some(Certainty::Likely)) } else { best };
        let mut clear = candidates.iter().filter(|(.., own)| {
            Some(own.certainty) >= least
                && !matches!(own.certainty, Certainty::Unclear | Certainty::Called)
        });
        let (Some((table, column, own)), None) = (clear.next(), clear.next()) else {
            return Ok(Err(candidates));
        };
        let across = match quantity {
            Quantity::Force => self.across(*table, *column)?,
            _ => Ok(String::new()),
        };
        let across = match across {
            Ok(across) => across,
            Err(axes) => return Ok(Err(axes)),
        };
        let why = format!("{}{across}{}", own.why, self.instead((*table, *column), &candidates));
        let slot = Slot::of(quantity, own.per_si.unwrap_or(1.0));
        Ok(Ok(Taken { quantity, table: *table, column: *column, slot, why: Some(why) }))
    }

    /// The columns that could be taken in place of this one, and how.
    fn instead(&self, (table, column): (usize, usize), all: &[Place]) -> String {
        let others = all.iter().filter(|(t, c, own)| {
            let is_same = (*t, *c) == (table, column);
            !is_same && (own.quantity == Quantity::Force || own.certainty > Certainty::Unclear)
        });
        let words: Vec<String> = others
            .filter_map(|(t, c, own)| {
                let name = self.name(*t, *c);
                let option = entry(own.quantity, own.per_si.unwrap_or(1.0), &name)?;
                Some(format!("{name}, which ‹columns='{option}'› would take"))
            })
            .collect();
        if words.is_empty() {
            String::new()
        } else {
            format!("; preferred to {}", words.join(", and to "))
        }
    }

    /// Of a wrench, the axis with the largest range is likely that of the instrument: evidence for
    /// its z axis, or all axes if another one has more.
    fn across(
        &self,
        table: usize,
        column: usize,
    ) -> Result<Result<String, Vec<Place>>, RecordingError> {
        let columns = &self.container.tables[table].columns;
        let Some(front) = columns[column].name.strip_suffix("force.z") else {
            return Ok(Ok(String::new()));
        };
        let find = |axis: &str| {
            let name = format!("{front}force.{axis}");
            columns.iter().position(|own| own.name == name && own.is_numeric)
        };
        let (Some(x), Some(y)) = (find("x"), find("y")) else { return Ok(Ok(String::new())) };
        let ranges = widths(&limits(self.container, table, &[x, y, column])?);
        let [of_x, of_y, of_z] = ranges[..] else { return Ok(Ok(String::new())) };
        if of_z >= of_x.max(of_y) {
            return Ok(Ok(format!(" (range {of_z:.3} N; x {of_x:.3} N, y {of_y:.3} N)")));
        }
        Ok(Err([(x, of_x), (y, of_y), (column, of_z)]
            .map(|(column, range)| {
                let why = format!("range {range:.3} N");
                let (quantity, certainty) = (Quantity::Force, Certainty::Unclear);
                (table, column, Candidate { quantity, per_si: Some(1.0), why, certainty })
            })
            .into()))
    }

    /// Of a pose, the axis with nearly all of the travel is likely that of the instrument.
    fn settle_axes(&self, candidates: &mut [Place]) -> Result<(), RecordingError> {
        if candidates.iter().any(|(.., candidate)| candidate.certainty > Certainty::Unclear) {
            return Ok(());
        }
        for axes in candidates.chunk_by_mut(|a, b| a.0 == b.0).filter(|axes| axes.len() == 3) {
            let places: Vec<usize> = axes.iter().map(|(_, column, _)| *column).collect();
            let ranges = widths(&limits(self.container, axes[0].0, &places)?);
            if let Some(axis) = axis_of_travel(&ranges) {
                let candidate = &mut axes[axis].2;
                candidate.certainty = Certainty::Likely;
                let all: Vec<String> = ranges.iter().map(|range| format!("{range:.4} m")).collect();
                candidate.why = format!(
                    "the axis that carries nearly all of the travel (ranges: {})",
                    all.join(", ")
                );
            }
        }
        Ok(())
    }

    /// The error about all that is unclear. Its option has one column for each: of several sensors
    /// the one with the largest range.
    fn unclear(
        &self,
        given: &[Given],
        taken: &[Taken],
        unclear: &[(Quantity, Vec<Place>)],
    ) -> Result<RecordingError, RecordingError> {
        let mut problems = Vec::new();
        let mut entries: Vec<String> = given.iter().map(Given::entry).collect();
        let mut used: Vec<(usize, usize)> =
            taken.iter().map(|own| (own.table, own.column)).collect();
        for (quantity, candidates) in unclear {
            let could_be: Vec<String> = candidates
                .iter()
                .map(|(t, c, candidate)| format!("{} ({})", self.name(*t, *c), candidate.why))
                .collect();
            let found = match could_be.is_empty() {
                true => format!("nothing says so among {}", columns::listed(&self.names())),
                false => format!("it could be {}", could_be.join(" or ")),
            };
            problems.push(format!("no topic is clearly the {}: {found}", quantity.name()));
            if let Some((place, per_si)) = self.likely(*quantity, candidates, &used)? {
                used.push(place);
                entries.extend(entry(*quantity, per_si, &self.name(place.0, place.1)));
            }
        }
        let is_whole = entries.len() == given.len() + unclear.len();
        let option = is_whole.then(|| {
            format!("say which, for example ‹columns='{}'› (a guess); ", entries.join(","))
        });
        Ok(RecordingError::UnclearTopic {
            file: self.file.to_owned(),
            problems: problems.join("; "),
            option: option.unwrap_or_default(),
        })
    }

    /// The most likely of the columns that may be a quantity, or else the one whose unit or place
    /// fits, and its unit.
    fn likely(
        &self,
        quantity: Quantity,
        candidates: &[Place],
        used: &[(usize, usize)],
    ) -> Result<Option<Proposal>, RecordingError> {
        let mut best: Option<(Rank, Proposal)> = None;
        for (table, column, own) in candidates {
            let [low, high] = limits(self.container, *table, &[*column])?[0];
            // The third joint of an arm without names is the insertion.
            let is_third = self.container.tables[*table].columns[*column].name.ends_with("[2]");
            let rank = (
                own.certainty.min(Certainty::Likely),
                is_third,
                if high > low { high - low } else { 0.0 },
            );
            if best.is_none_or(|(other, ..)| rank > other) {
                let per_si = own.per_si.unwrap_or_else(|| likely_unit(quantity, &[low, high]));
                best = Some((rank, ((*table, *column), per_si)));
            }
        }
        if let Some((_, own)) = best {
            return Ok(Some(own));
        }
        let tables = &self.container.tables;
        let free: Vec<(usize, usize)> = self
            .columns()
            .filter(|place| {
                let (topic, name) = (&tables[place.0], &tables[place.0].columns[place.1].name);
                let is_clock = name.ends_with("_time_s") || name == HEADER_STAMP;
                let is_nothing = meaning(&topic.name, &topic.kind, name) == Meaning::Nothing;
                !is_clock && !is_nothing && !used.contains(place)
            })
            .collect();
        let mut of_unit = free.iter().filter_map(|&(table, column)| {
            let unit = tables[table].columns[column].unit.as_deref()?;
            Some(((table, column), quantity.declared(unit)?))
        });
        if let (Some(only), None) = (of_unit.next(), of_unit.next()) {
            return Ok(Some(only));
        }
        let [(table, column)] = free[..] else { return Ok(None) };
        let [low, high] = limits(self.container, table, &[column])?[0];
        Ok(Some(((table, column), likely_unit(quantity, &[low, high]))))
    }

    /// The column of `table` that has the name of the clock chosen by the user.
    fn same_clock(&self, clock: &Taken, table: usize) -> Result<usize, RecordingError> {
        let tables = &self.container.tables;
        let name = &tables[clock.table].columns[clock.column].name;
        let found = tables[table]
            .columns
            .iter()
            .position(|column| column.name == *name && column.is_numeric);
        found.ok_or_else(|| {
            let problem = format!(
                "a clock that {} does not have: topics are joined on one",
                tables[table].name
            );
            RecordingError::bad_columns(self.name(clock.table, clock.column), problem)
        })
    }

    /// All selected columns, as rows at the times of the first.
    fn joined(
        &self,
        taken: &[Taken],
        clock: Option<Taken>,
        given: &[Given],
    ) -> Result<Chosen, RecordingError> {
        let mut picks: Vec<Pick> = Vec::new();
        for column in taken {
            match picks.iter_mut().find(|pick| pick.table == column.table) {
                Some(pick) => pick.values.push(column.column),
                None => {
                    let own = clock
                        .as_ref()
                        .map(|clock| self.same_clock(clock, column.table))
                        .transpose()?;
                    picks.push(Pick {
                        table: column.table,
                        clock: own,
                        values: vec![column.column],
                    });
                }
            }
        }
        let joined =
            join(self.container, &picks, 0, &given.iter().map(Given::entry).collect::<Vec<_>>())?;
        let mut names =
            vec![format!("{}.{}", self.container.tables[picks[0].table].name, joined.clock)];
        let time = clock
            .as_ref()
            .map_or(Slot { output: Quantity::Time as usize, per_si: 1.0 }, |clock| clock.slot);
        let mut slots = vec![Some(time)];
        let mut notes = Vec::new();
        for (pick, column) in picks
            .iter()
            .flat_map(|pick| pick.values.iter().map(move |column| (pick.table, *column)))
        {
            let own = taken
                .iter()
                .find(|taken| (taken.table, taken.column) == (pick, column))
                .expect("picked from these");
            names.push(self.name(pick, column));
            slots.push(Some(own.slot));
            notes.extend(own.why.as_ref().map(|why| {
                format!("{} taken as {}: {why}", self.name(pick, column), own.quantity.name())
            }));
        }
        notes.extend(joined.notes);
        let source = "‹columns›";
        let layout = Layout { names, slots, source, notes, is_log: true, ..Layout::default() };
        Ok(Chosen { layout, batches: joined.batches, warnings: joined.warnings })
    }
}

/// A number whose name, or that of its topic, is a quantity, such as `/bench/force_n` or the field
/// `position` of a message of another type.
fn by_name(topic: &Table, column: usize) -> Option<Candidate> {
    let field = &topic.columns[column];
    let (name, whose) = match &*field.name {
        "data" => (topic.name.rsplit('/').next().unwrap_or_default(), "its topic"),
        own => (own, "its field"),
    };
    let declared = field.unit.as_deref().unwrap_or_default();
    let reading = reading_of(name, declared, &mut Vec::new())?;
    if reading.quantity == Quantity::Time {
        return None;
    }
    let (certainty, unit) = match reading.per_si {
        Some(_) => (Certainty::Clear, ""),
        None => (Certainty::Called, ", without a known unit"),
    };
    let why = format!("by the name of {whose}{unit}");
    Some(Candidate { quantity: reading.quantity, per_si: reading.per_si, why, certainty })
}

/// Least and largest number of each column of a table.
fn limits(
    container: &Container,
    table: usize,
    columns: &[usize],
) -> Result<Vec<[f64; 2]>, RecordingError> {
    let mut limits = vec![[f64::INFINITY, f64::NEG_INFINITY]; columns.len()];
    let mut batches = container.open(table, columns)?;
    let mut rows = vec![Vec::new(); columns.len()];
    while batches.next(&mut rows)? {
        for ([low, high], column) in limits.iter_mut().zip(&rows) {
            column
                .iter()
                .filter(|x| x.is_finite())
                .for_each(|x| (*low, *high) = (low.min(*x), high.max(*x)));
        }
    }
    Ok(limits)
}

fn widths(limits: &[[f64; 2]]) -> Vec<f64> {
    limits.iter().map(|[low, high]| (high - low).max(0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Column;
    use crate::container::{Content, Opened};
    use crate::formats::Source;

    const JOINTS: &str = "sensor_msgs/msg/JointState";
    const WRENCH: &str = "geometry_msgs/msg/WrenchStamped";
    const NEEDED: [Quantity; 3] = [Quantity::Time, Quantity::Position, Quantity::Force];

    /// Topics in memory: a sine at 1 kHz times the factor of each column.
    struct Log {
        factors: Vec<Vec<f64>>,
    }

    type Topic<'a> = (&'a str, &'a str, &'a [(&'a str, f64)]);

    fn log(topics: &[Topic]) -> Container {
        let column = |name: &str| Column { name: name.into(), unit: None, is_numeric: true };
        let table = |(name, kind, fields): &Topic| {
            let fields = fields.iter().map(|(field, _)| column(field));
            let columns = [HEADER_STAMP, LOG_TIME].map(column).into_iter().chain(fields).collect();
            Table { name: (*name).into(), kind: (*kind).into(), rows: None, columns }
        };
        let factors = topics.iter().map(|(.., fields)| fields.iter().map(|own| own.1).collect());
        let source = Source { file: "log".into(), format: "test" };
        let log = Log { factors: factors.collect() };
        Container::new(source, topics.iter().map(table).collect(), log)
    }

    struct Once(Vec<Vec<f64>>);

    impl Content for Log {
        fn open(&self, table: usize, _: &Table, columns: &[usize]) -> Opened {
            let value = |column: usize, k: usize| match column {
                0 | 1 => 1e-3 * k as f64,
                _ => self.factors[table][column - 2] * (0.02 * k as f64).sin(),
            };
            let all = columns.iter().map(|own| (0..500).map(|k| value(*own, k)).collect());
            Ok(Box::new(Once(all.collect())))
        }
    }

    impl Batches for Once {
        fn next(&mut self, columns: &mut [Vec<f64>]) -> Result<bool, RecordingError> {
            let rows = std::mem::replace(&mut self.0, vec![Vec::new(); columns.len()]);
            columns.iter_mut().zip(rows).for_each(|(own, rows)| *own = rows);
            Ok(columns.first().is_some_and(|own| !own.is_empty()))
        }
    }

    fn chosen(log: &Container, columns: Option<&str>) -> Result<(Vec<String>, String), String> {
        let choice = Choice { columns: columns.map(str::to_owned), ..Choice::default() };
        let chosen = choose("log", log, &choice, &NEEDED).map_err(|error| error.to_string())?;
        Ok((chosen.layout.words(), chosen.layout.notes.join("; ")))
    }

    /// The option of a message is taken as it is.
    fn follow(log: &Container, message: &str) -> Vec<String> {
        let option = message.split("‹columns='").nth(1).unwrap_or_else(|| panic!("{message}"));
        let option = option.split('\'').next().unwrap();
        chosen(log, Some(option)).unwrap_or_else(|error| panic!("{message}\n{error}")).0
    }

    const ARM: Topic =
        ("/PSM1/measured_js", JOINTS, &[("position[insertion]", 0.05), ("effort[insertion]", 4.0)]);
    const OF_ARM: Topic = (
        "/PSM1/measured_cf",
        WRENCH,
        &[("wrench.force.x", 0.1), ("wrench.force.y", 0.1), ("wrench.force.z", 4.0)],
    );
    const SENSOR: Topic = (
        "/ati/wrench",
        WRENCH,
        &[("wrench.force.x", 0.1), ("wrench.force.y", 0.2), ("wrench.force.z", 3.0)],
    );

    #[test]
    fn a_force_sensor_goes_before_what_is_computed_from_motors() {
        for topics in [[ARM, OF_ARM, SENSOR], [SENSOR, ARM, OF_ARM]] {
            let (words, notes) = chosen(&log(&topics), None).unwrap();
            assert_eq!(words[2], "force_n=/ati/wrench.wrench.force.z");
            for essential in [
                "preferred to /PSM1/measured_js.effort[insertion], which ‹columns='force_n=",
                "/PSM1/measured_cf.wrench.force.z, which ‹columns='force_n=/PSM1/measured_cf.wrench.force.z'› would take",
                "(range 6.000 N; x 0.200 N, y 0.400 N)",
            ] {
                let is_there = notes.contains(essential)
                    || essential.starts_with("preferred") && notes.contains(&essential[13..]);
                assert!(is_there, "{essential} not in {notes}");
            }
        }
        let (words, notes) = chosen(&log(&[ARM, OF_ARM]), None).unwrap();
        assert_eq!(words[2], "force_n=/PSM1/measured_cf.wrench.force.z");
        assert!(
            notes.contains("the arm's own estimate from the currents of its motors"),
            "{notes}"
        );
    }

    #[test]
    fn a_column_is_named_by_topic_and_field_or_by_the_only_field() {
        let log = log(&[ARM, OF_ARM, SENSOR]);
        let by =
            |force: &str| chosen(&log, Some(&format!("position_m=position[insertion],{force}")));
        for name in ["/ati/wrench.wrench.force.z", "/ATI/Wrench.wrench.force.z"] {
            let (words, _) = by(&format!("force_n={name}")).unwrap();
            assert_eq!(words[2], "force_n=/ati/wrench.wrench.force.z");
        }
        let message = by("force_n=wrench.force.z").unwrap_err();
        assert!(message.contains("a name that no column has, expected one of"), "{message}");
        assert!(message.contains("/PSM1/measured_cf.wrench.force.z"), "{message}");
    }

    #[test]
    fn two_sensors_are_a_question_whatever_they_are_called() {
        let fields = [("wrench.force.x", 0.0), ("wrench.force.y", 0.0), ("wrench.force.z", 1.0)];
        for other in ["/ft/measured_cf", "/netft_data", "/bota/wrench"] {
            let log = log(&[ARM, OF_ARM, SENSOR, (other, WRENCH, &fields)]);
            let message = chosen(&log, None).unwrap_err();
            assert!(message.contains("no topic is clearly the force: it could be "), "{message}");
            assert!(message.contains("/ati/wrench.wrench.force.z (") && message.contains(other));
            assert_eq!(follow(&log, &message)[2], "force_n=/ati/wrench.wrench.force.z");
        }
        // A number that is called a load may be the sensor.
        let log = log(&[ARM, OF_ARM, ("/load_cell", "std_msgs/msg/Float64", &[("data", 3.0)])]);
        let message = chosen(&log, None).unwrap_err();
        assert_eq!(follow(&log, &message)[2], "force_n=/load_cell.data");
    }

    #[test]
    fn the_axis_of_a_wrench_is_asked_where_another_has_more_force() {
        let sideways = [("wrench.force.x", 3.0), ("wrench.force.y", 0.1), ("wrench.force.z", 0.2)];
        let log = log(&[ARM, ("/ati/wrench", WRENCH, &sideways)]);
        let message = chosen(&log, None).unwrap_err();
        assert!(message.contains("wrench.force.x (range 6.000 N)"), "{message}");
        assert_eq!(follow(&log, &message)[2], "force_n=/ati/wrench.wrench.force.x");
    }

    #[test]
    fn all_that_is_unclear_is_asked_at_once_by_topics_of_the_log() {
        let joints: Vec<String> = (0..6).map(|k| format!("position[{k}]")).collect();
        let joints: Vec<(&str, f64)> = joints.iter().map(|own| (&**own, 0.1)).collect();
        let own = log(&[("/PSM1/measured_js", JOINTS, &joints), SENSOR, ("/ft", WRENCH, SENSOR.2)]);
        let message = chosen(&own, None).unwrap_err();
        let words = follow(&own, &message);
        assert_eq!(words[1], "position_m=/PSM1/measured_js.position[2]");
        // What the user has said stays said.
        let given = "force_n=/ft.wrench.force.z";
        let message = chosen(&own, Some(given)).unwrap_err();
        assert_eq!(follow(&own, &message)[2], given);
        // Messages of other types, by their fields: with units, and without.
        let clear = log(&[("/rig", "json", &[("position_mm", 50.0), ("load_mn", 3000.0)])]);
        let (words, _) = chosen(&clear, None).unwrap();
        assert_eq!(words[1..], ["position_mm=/rig.position_mm", "force_mn=/rig.load_mn"]);
        let open = log(&[("/rig", "json", &[("position", 50.0), ("force.z", 3.0)])]);
        let message = chosen(&open, None).unwrap_err();
        assert_eq!(
            follow(&open, &message)[1..],
            ["position_mm=/rig.position", "force_n=/rig.force.z"]
        );
        // Nothing that turns is proposed as a force.
        let none = log(&[ARM, ("/tool", "json", &[("a", 1.0), ("b", 2.0)])]);
        let without = log(&[("/PSM1/measured_js", JOINTS, &[("position[insertion]", 0.05)])]);
        for log in [without, none] {
            let found = chosen(&log, None);
            assert!(!found.is_err_and(|message| message.contains("‹columns")));
        }
    }
}
