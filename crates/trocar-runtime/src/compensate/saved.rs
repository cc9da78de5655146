//! The state of an observer as a row of numbers. The same lines write and read it, so that both
//! have the same order.

use trocar_model::{Trocar, TrocarState};

/// A row under way: to be written, or to be read.
pub(super) enum StateRow<'a> {
    /// The numbers so far.
    Written(&'a mut Vec<f64>),
    /// The numbers that are left; whether one was missing or is none that may stand there.
    Read { left: &'a [f64], is_damaged: bool },
}

impl<'a> StateRow<'a> {
    pub(super) fn of(row: &'a [f64]) -> Self {
        Self::Read { left: row, is_damaged: false }
    }

    /// Whether a row was read to its end without damage.
    pub(super) fn is_whole(&self) -> bool {
        matches!(self, Self::Read { left: [], is_damaged: false })
    }

    fn refuse(&mut self) {
        if let Self::Read { is_damaged, .. } = self {
            *is_damaged = true;
        }
    }

    /// A number that stands in every row.
    pub(super) fn expect(&mut self, number: f64) {
        let mut found = number;
        self.number(&mut found);
        if found != number {
            self.refuse();
        }
    }

    /// Writes `value`, or replaces it by the next number.
    pub(super) fn number(&mut self, value: &mut f64) {
        match self {
            Self::Written(row) => row.push(*value),
            Self::Read { left, is_damaged } => match left.split_first() {
                Some((first, rest)) => (*value, *left) = (*first, rest),
                None => *is_damaged = true,
            },
        }
    }

    pub(super) fn numbers(&mut self, values: &mut [f64]) {
        values.iter_mut().for_each(|value| self.number(value));
    }

    /// A whole number from 0 to `most`, at most 2^53.
    pub(super) fn count<T: Copy + TryFrom<u64> + TryInto<u64>>(
        &mut self,
        value: &mut T,
        most: u64,
    ) {
        let mut found = (*value).try_into().map_or(f64::NAN, |count: u64| count as f64);
        self.number(&mut found);
        let is_count = found >= 0.0 && found <= most as f64 && found.floor() == found;
        match T::try_from(found as u64) {
            Ok(count) if is_count => *value = count,
            _ => self.refuse(),
        }
    }

    pub(super) fn flag(&mut self, value: &mut bool) {
        let mut count = u64::from(*value);
        self.count(&mut count, 1);
        *value = count == 1;
    }

    /// Index of a cell; it came from a number, so that none is lost.
    pub(super) fn cell(&mut self, value: &mut i64) {
        let mut found = *value as f64;
        self.number(&mut found);
        *value = found as i64;
    }

    /// Whether there is a value, then what `fields` gives of it; a value read begins as `blank`.
    pub(super) fn optional<T>(
        &mut self,
        value: &mut Option<T>,
        blank: T,
        fields: impl FnOnce(&mut T, &mut Self),
    ) {
        let mut is_there = value.is_some();
        self.flag(&mut is_there);
        *value = is_there.then(|| {
            let mut own = value.take().unwrap_or(blank);
            fields(&mut own, self);
            own
        });
    }

    /// The state of `model`.
    pub(super) fn state(&mut self, model: &Trocar, state: &mut TrocarState) {
        let mut numbers = state.to_numbers();
        self.numbers(&mut numbers);
        match model.state_from_numbers(&numbers) {
            Ok(read) => *state = read,
            Err(_) => self.refuse(),
        }
    }
}
