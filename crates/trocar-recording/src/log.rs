//! Selects the topics of a robot log that are position, velocity and force, and aligns them on one
//! clock.

use super::RecordingError;
use super::choice::{Choice, allowed};
use super::columns::{self, Given, Layout, Quantity, Slot};
use super::container::{Batches, Container, Table};
use super::crtk::{Candidate, Certainty, Meaning, axis_of_travel, meaning};
use super::formats::{HEADER_STAMP, LOG_TIME};
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

/// Whether tables are topics of a log: they have log times.
pub(super) fn is_log(tables: &[Table]) -> bool {
    let is_clock = |name: &str| name == HEADER_STAMP || name == LOG_TIME;
    tables.iter().any(|table| table.columns.iter().any(|column| is_clock(&column.name)))
}

/// Finds the quantities in the topics of `container` and aligns them to the times of the position.
pub(super) fn choose(
    file: &str,
    container: &dyn Container,
    choice: &Choice,
    needed: &[Quantity],
) -> Result<Chosen, RecordingError> {
    if choice.rate_hz.is_some() {
        let problem =
            "is for a table without times, and this is a log with times of its own".to_owned();
        return Err(RecordingError::BadOption {
            file: file.to_owned(),
            option: "--rate-hz",
            problem,
        });
    }
    let topics =
        Topics { file, container, allowed: allowed(file, container.tables(), &choice.topics)? };
    let given = match choice.columns.as_deref() {
        Some(mapping) if !mapping.contains('=') => return Err(topics.in_order(mapping)),
        mapping => mapping.map_or(Ok(Vec::new()), Given::parse)?,
    };
    let mut taken = Vec::new();
    for quantity in [Quantity::Position, Quantity::Force, Quantity::Velocity] {
        let own = given.iter().find(|given| given.quantity == quantity);
        let position = taken.first().map(|taken: &Taken| taken.table);
        taken.extend(match own {
            Some(given) => Some(topics.named(given)?),
            None => topics.found(quantity, needed.contains(&quantity), position)?,
        });
    }
    for (k, own) in taken.iter().enumerate() {
        if taken[..k].iter().any(|other| (other.table, other.column) == (own.table, own.column)) {
            let problem = "a column named for two quantities, expected one".to_owned();
            return Err(RecordingError::BadColumns {
                entry: topics.name(own.table, own.column),
                problem,
            });
        }
    }
    let clock = given
        .iter()
        .find(|given| given.quantity == Quantity::Time)
        .map(|given| topics.named(given));
    topics.joined(&taken, clock.transpose()?)
}

struct Topics<'a> {
    file: &'a str,
    container: &'a dyn Container,
    allowed: Vec<usize>,
}

impl Topics<'_> {
    fn in_order(&self, mapping: &str) -> RecordingError {
        let problem = "in order, but a log has topics: name them, as in position_m=TOPIC.FIELD,force_n=TOPIC.FIELD";
        RecordingError::BadColumns { entry: mapping.to_owned(), problem: problem.to_owned() }
    }

    /// `TOPIC.FIELD`.
    fn name(&self, table: usize, column: usize) -> String {
        let table = &self.container.tables()[table];
        format!("{}.{}", table.name, table.columns[column].name)
    }

    /// All numeric columns of the topics to search.
    fn columns(&self) -> impl Iterator<Item = (usize, usize)> {
        let tables = self.container.tables();
        let of = move |table: &usize| {
            let table = *table;
            (0..tables[table].columns.len()).map(move |column| (table, column))
        };
        self.allowed
            .iter()
            .flat_map(of)
            .filter(move |(table, column)| tables[*table].columns[*column].is_numeric)
    }

    /// The column that `--columns` names: by topic and field, or by the field alone if only one
    /// topic has it.
    fn named(&self, given: &Given) -> Result<Taken, RecordingError> {
        let field =
            |(table, column): (usize, usize)| &self.container.tables()[table].columns[column].name;
        let whole =
            self.columns().find(|&(table, column)| self.name(table, column) == given.column);
        let mut alone = self.columns().filter(|place| *field(*place) == given.column);
        let found = whole.or_else(|| alone.next().filter(|_| alone.next().is_none()));
        let Some((table, column)) = found else {
            let names: Vec<String> =
                self.columns().map(|(table, column)| self.name(table, column)).collect();
            let problem = format!(
                "not the name of one column of one topic, expected one of {}",
                columns::listed(&names)
            );
            return Err(RecordingError::BadColumns { entry: given.column.clone(), problem });
        };
        let unit = match self.candidate(table, column) {
            Some(candidate) if candidate.quantity == given.quantity => {
                format!(" {}", candidate.unit)
            }
            _ => self.container.tables()[table].columns[column]
                .unit
                .as_ref()
                .map_or(String::new(), |u| format!(" {u}")),
        };
        let slot = given.slot_for(&format!("{}{unit}", given.quantity.name()))?;
        Ok(Taken { quantity: given.quantity, table, column, slot, why: None })
    }

    /// Meaning of a column according to names and types.
    fn candidate(&self, table: usize, column: usize) -> Option<Candidate> {
        let topic = &self.container.tables()[table];
        match meaning(&topic.name, &topic.kind, &topic.columns[column].name) {
            Meaning::Candidate(candidate) => Some(candidate),
            Meaning::Command(_) => None,
            Meaning::Unknown => by_topic_name(topic, column),
        }
    }

    /// The column that is clearly a quantity. Velocity is taken only from the topic of the
    /// position.
    fn found(
        &self,
        quantity: Quantity,
        needed: bool,
        position: Option<usize>,
    ) -> Result<Option<Taken>, RecordingError> {
        let of =
            |(table, column): (usize, usize)| Some((table, column, self.candidate(table, column)?));
        let mut candidates: Vec<(usize, usize, Candidate)> = self
            .columns()
            .filter_map(of)
            .filter(|(_, _, candidate)| candidate.quantity == quantity)
            .collect();
        if quantity == Quantity::Velocity {
            candidates.retain(|(table, _, candidate)| {
                Some(*table) == position && candidate.certainty == Certainty::Clear
            });
        }
        if quantity == Quantity::Position {
            self.settle_axes(&mut candidates)?;
        }
        let best = candidates.iter().map(|(_, _, candidate)| candidate.certainty).max();
        let mut clear = candidates
            .iter()
            .filter(|(_, _, c)| Some(c.certainty) == best && c.certainty > Certainty::Unclear);
        match (clear.next(), clear.next()) {
            (Some((table, column, candidate)), None) => Ok(Some(Taken {
                quantity,
                table: *table,
                column: *column,
                slot: Slot { output: quantity as usize, per_si: 1.0 },
                why: Some(format!(
                    "{}{}",
                    candidate.why,
                    self.instead(quantity, *table, *column, &candidates)
                )),
            })),
            _ if !needed => Ok(None),
            _ => Err(self.unclear(quantity, &candidates)),
        }
    }

    /// How to choose the effort of a motor where a force sensor was taken.
    fn instead(
        &self,
        quantity: Quantity,
        table: usize,
        column: usize,
        all: &[(usize, usize, Candidate)],
    ) -> String {
        let is_other = |(t, c, candidate): &&(usize, usize, Candidate)| {
            (*t, *c) != (table, column) && candidate.certainty == Certainty::Indirect
        };
        let other = all
            .iter()
            .find(is_other)
            .map(|(t, c, candidate)| (self.name(*t, *c), candidate.unit.to_lowercase()));
        other.map_or(String::new(), |(name, unit)| {
            format!(
                "; preferred to {name}, which --columns '{}_{unit}={name}' would take",
                quantity.name()
            )
        })
    }

    /// Of a pose, the axis with nearly all of the travel is likely that of the instrument.
    fn settle_axes(
        &self,
        candidates: &mut [(usize, usize, Candidate)],
    ) -> Result<(), RecordingError> {
        if candidates.iter().any(|(_, _, candidate)| candidate.certainty > Certainty::Unclear) {
            return Ok(());
        }
        for axes in candidates.chunk_by_mut(|a, b| a.0 == b.0).filter(|axes| axes.len() == 3) {
            let places: Vec<usize> = axes.iter().map(|(_, column, _)| *column).collect();
            let ranges = ranges(self.container, axes[0].0, &places)?;
            if let Some(axis) = axis_of_travel([ranges[0], ranges[1], ranges[2]]) {
                let candidate = &mut axes[axis].2;
                candidate.certainty = Certainty::Likely;
                "the axis that carries nearly all of the travel".clone_into(&mut candidate.why);
            }
        }
        Ok(())
    }

    fn unclear(
        &self,
        quantity: Quantity,
        candidates: &[(usize, usize, Candidate)],
    ) -> RecordingError {
        let could_be: Vec<String> = candidates
            .iter()
            .map(|(t, c, candidate)| format!("{} ({})", self.name(*t, *c), candidate.why))
            .collect();
        let names: Vec<String> =
            self.columns().map(|(table, column)| self.name(table, column)).collect();
        let found = match could_be.is_empty() {
            true => format!("nothing says so among {}", columns::listed(&names)),
            false => format!("it could be {}", could_be.join(" or ")),
        };
        let example =
            candidates.first().map_or("TOPIC.FIELD".to_owned(), |(t, c, _)| self.name(*t, *c));
        RecordingError::UnclearTopic {
            file: self.file.to_owned(),
            quantity: quantity.name(),
            found,
            example: format!("{}={example}", quantity.example()),
        }
    }

    /// The column of `table` that has the name of the clock chosen by the user.
    fn same_clock(&self, clock: &Taken, table: usize) -> Result<usize, RecordingError> {
        let tables = self.container.tables();
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
            RecordingError::BadColumns { entry: self.name(clock.table, clock.column), problem }
        })
    }

    /// All selected columns, as rows at the times of the first.
    fn joined(&self, taken: &[Taken], clock: Option<Taken>) -> Result<Chosen, RecordingError> {
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
        let joined = join(self.container, &picks, 0)?;
        let mut names =
            vec![format!("{}.{}", self.container.tables()[picks[0].table].name, joined.clock)];
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
        let layout = Layout { names, slots, source: "--columns", notes, ..Layout::default() };
        Ok(Chosen { layout, batches: joined.batches, warnings: joined.warnings })
    }
}

/// A topic of single numbers whose name is a quantity with its unit, such as `/bench/force_n`.
fn by_topic_name(topic: &Table, column: usize) -> Option<Candidate> {
    if topic.columns[column].name != "data" {
        return None;
    }
    let name = topic.name.rsplit('/').next().unwrap_or_default();
    let (quantity, unit) = columns::si_quantity(name)?;
    let why = "by the name of its topic".to_owned();
    (quantity != Quantity::Time).then_some(Candidate {
        quantity,
        unit,
        why,
        certainty: Certainty::Clear,
    })
}

/// Range of each column of a table.
fn ranges(
    container: &dyn Container,
    table: usize,
    columns: &[usize],
) -> Result<Vec<f64>, RecordingError> {
    let mut limits = vec![(f64::INFINITY, f64::NEG_INFINITY); columns.len()];
    let mut batches = container.open(table, columns)?;
    let mut rows = vec![Vec::new(); columns.len()];
    while batches.next(&mut rows)? {
        for ((low, high), column) in limits.iter_mut().zip(&rows) {
            column
                .iter()
                .filter(|x| x.is_finite())
                .for_each(|x| (*low, *high) = (low.min(*x), high.max(*x)));
        }
    }
    Ok(limits.into_iter().map(|(low, high)| (high - low).max(0.0)).collect())
}
