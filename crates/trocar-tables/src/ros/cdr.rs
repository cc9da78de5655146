//! Numbers from serialised ROS messages, without decoding other fields.
//!
//! ROS 2 (`cdr`): four bytes that state the byte order, followed by the fields in order, each
//! number aligned to its own size relative to the first byte after those four (plain CDR of version
//! 1; key CDR in SOURCES.md). ROS 1 (`ros1`): the same fields in little endian without those four
//! bytes and without alignment. A string is a count of bytes and the bytes; a sequence is a count
//! and the elements.
//!
//! A [`Plan`] is made once from a definition and the requested fields. It steps through a message
//! up to the last of them, by arithmetic where sizes are fixed, and reads only these fields.

use super::definition::{Arity, Field, Kind, Struct};
use crate::content::Storage;

/// Serialisation of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Layout {
    Cdr,
    Ros1,
}

/// One step on the path from a message to a number in it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Step {
    /// Field of a struct, by its index.
    Field(usize),
    /// Element of an array, counted from 0.
    Element(usize),
    /// Element of an array at the index of this string in an array of names: the field with index
    /// `.1` of the struct that is `.0` levels further out.
    Named(String, Names),
}

/// An array of names: a field of the message at the end of a path of fields.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Names(pub(crate) Vec<usize>);

/// The bytes of a message, and the current position.
#[derive(Clone, Copy)]
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    big: bool,
    aligned: bool,
}

/// The first two bytes of a payload in plain CDR of version 1.
const CDR_BIG: [u8; 2] = [0, 0];
const CDR_LITTLE: [u8; 2] = [0, 1];

impl<'a> Cursor<'a> {
    /// At the first field; `None` if the payload does not have the expected layout.
    pub(crate) fn new(layout: Layout, payload: &'a [u8]) -> Option<Self> {
        match layout {
            Layout::Ros1 => Some(Self { bytes: payload, at: 0, big: false, aligned: false }),
            Layout::Cdr => {
                let (head, bytes) = payload.split_at_checked(4)?;
                let big = head[..2] == CDR_BIG;
                (big || head[..2] == CDR_LITTLE).then_some(Self {
                    bytes,
                    at: 0,
                    big,
                    aligned: true,
                })
            }
        }
    }

    fn align(&mut self, size: usize) {
        if self.aligned {
            self.at = self.at.next_multiple_of(size);
        }
    }

    /// Skips `count` numbers of `size` bytes.
    fn pass(&mut self, size: usize, count: usize) -> Option<()> {
        if count > 0 {
            self.align(size);
            self.at = self.at.checked_add(size.checked_mul(count)?)?;
        }
        (self.at <= self.bytes.len()).then_some(())
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.align(N);
        let mut bytes: [u8; N] = self.bytes.get(self.at..)?.first_chunk().copied()?;
        self.at += N;
        if self.big {
            bytes.reverse();
        }
        Some(bytes)
    }

    fn number(&mut self, storage: Storage) -> Option<f64> {
        let size = storage.size();
        self.align(size);
        let bytes = self.bytes.get(self.at..)?.get(..size)?;
        self.at += size;
        Some(storage.number(bytes, self.big))
    }

    fn count(&mut self) -> Option<usize> {
        usize::try_from(u32::from_le_bytes(self.take()?)).ok()
    }

    /// Seconds and nanoseconds as nanoseconds; seconds are signed in ROS 2 only.
    fn nanoseconds(&mut self) -> Option<i64> {
        let seconds: [u8; 4] = self.take()?;
        let nanoseconds = u32::from_le_bytes(self.take()?);
        let seconds = if self.aligned {
            i64::from(i32::from_le_bytes(seconds))
        } else {
            i64::from(u32::from_le_bytes(seconds))
        };
        Some(seconds * 1_000_000_000 + i64::from(nanoseconds))
    }

    /// The bytes of a string without the terminating NUL of CDR.
    fn text(&mut self) -> Option<&'a [u8]> {
        let length = self.count()?;
        let text = self.bytes.get(self.at..self.at.checked_add(length)?)?;
        self.at += length;
        Some(if self.aligned { text.strip_suffix(&[0]).unwrap_or(text) } else { text })
    }

    /// Number of elements that follow; rejects more than there are bytes left.
    fn elements(&mut self, arity: Arity) -> Option<usize> {
        let count = match arity {
            Arity::One => return Some(1),
            Arity::Fixed(count) => count,
            Arity::Counted => self.count()?,
        };
        (count <= self.bytes.len() - self.at.min(self.bytes.len())).then_some(count)
    }

    /// Skips a field.
    pub(crate) fn pass_field(&mut self, field: &Field) -> Option<()> {
        let count = self.elements(field.arity)?;
        match &field.kind {
            Kind::Number(storage) => self.pass(storage.size(), count),
            Kind::Stamp | Kind::Span => self.pass(4, count.checked_mul(2)?),
            Kind::Text => (0..count).try_for_each(|_| self.text().map(|_| ())),
            Kind::WideText => None,
            Kind::Struct(inner) => {
                for _ in 0..count {
                    let before = self.at;
                    self.pass_struct(inner)?;
                    if self.at == before {
                        break; // Nothing in it: the others hold nothing either.
                    }
                }
                Some(())
            }
        }
    }

    fn pass_struct(&mut self, inner: &Struct) -> Option<()> {
        if inner.fields.is_empty() {
            return self.pass_empty();
        }
        inner.fields.iter().try_for_each(|field| self.pass_field(field))
    }

    /// A struct without fields has one byte in ROS 2 and none in ROS 1.
    fn pass_empty(&mut self) -> Option<()> {
        self.pass(1, usize::from(self.aligned))
    }
}

/// Content of one message: the lengths of its arrays and the names in it, for listing its fields.
pub(crate) trait Visitor {
    /// A number, stamp or span at `path`, or a field that cannot be read as a number.
    fn leaf(&mut self, path: &[Step], field: &Field, parent: &Struct);

    /// An array of `count` elements; returns whether they are to be listed individually.
    fn array(&mut self, path: &[Step], field: &Field, count: usize) -> bool;

    /// An array of names.
    fn names(&mut self, path: &[Step], field: &Field, names: Vec<String>);
}

/// Passes every field of one message to `visitor`; `None` when the message ends before its
/// definition does.
pub(crate) fn visit(
    message: &Struct,
    cursor: &mut Cursor,
    path: &mut Vec<Step>,
    visitor: &mut dyn Visitor,
) -> Option<()> {
    if message.fields.is_empty() {
        return cursor.pass_empty();
    }
    for (place, field) in message.fields.iter().enumerate() {
        path.push(Step::Field(place));
        let result = visit_field(message, field, cursor, path, visitor);
        path.pop();
        result?;
    }
    Some(())
}

fn visit_field(
    parent: &Struct,
    field: &Field,
    cursor: &mut Cursor,
    path: &mut Vec<Step>,
    visitor: &mut dyn Visitor,
) -> Option<()> {
    let at = *cursor;
    let count = cursor.elements(field.arity)?;
    match (&field.kind, field.arity) {
        (Kind::Struct(inner), Arity::One) => return visit(inner, cursor, path, visitor),
        (_, Arity::One) => visitor.leaf(path, field, parent),
        (Kind::Text, _) => {
            let names = (0..count)
                .map(|_| Some(String::from_utf8_lossy(cursor.text()?).into_owned()))
                .collect::<Option<_>>()?;
            visitor.names(path, field, names);
        }
        (kind, _) if visitor.array(path, field, count) => {
            for k in 0..count {
                path.push(Step::Element(k));
                let result = match kind {
                    Kind::Struct(inner) => visit(inner, cursor, path, visitor),
                    _ => {
                        visitor.leaf(path, field, parent);
                        Some(())
                    }
                };
                path.pop();
                result?;
            }
        }
        _ => {}
    }
    *cursor = at;
    cursor.pass_field(field)
}

/// Instructions to reach some numbers of a message.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    layout: Layout,
    actions: Vec<Action>,
    /// For each array of names that is used, the names to find.
    registers: Vec<Register>,
    /// Subtracted from stamps, in ns.
    epoch: i64,
}

/// Action on a field.
#[derive(Debug, Clone)]
enum Action {
    Pass(Field),
    /// Writes a number to the given index of the row.
    Take(Kind, usize),
    /// Elements of an array of numbers.
    TakeSome(Kind, Arity, Vec<(Pick, usize)>),
    Enter(Vec<Action>),
    /// Elements of an array of structs, in ascending order.
    EnterSome(Struct, Arity, Vec<(usize, Vec<Action>)>),
    Remember(Arity, usize),
}

#[derive(Debug, Clone, Copy)]
enum Pick {
    At(usize),
    /// Index of the name `.1` of register `.0`.
    Named(usize, usize),
}

/// An array of names as in the previous message: it rarely changes, and is then skipped after one
/// comparison.
#[derive(Debug, Clone)]
struct Register {
    field: Names,
    wanted: Vec<String>,
    block: Vec<u8>,
    found: Vec<Option<usize>>,
}

/// One requested number: its path, and its index in the row.
type Wanted<'a> = (&'a [Step], usize);

impl Plan {
    /// The plan for the numbers at `paths`, in the order of the row; stamps count from `epoch`, ns.
    pub(crate) fn new(
        layout: Layout,
        message: &Struct,
        paths: &[(&[Step], usize)],
        epoch: i64,
    ) -> Self {
        let mut registers: Vec<Register> = Vec::new();
        for (path, _) in paths {
            if let Some(Step::Named(name, field)) = path.last() {
                let register = match registers.iter_mut().find(|register| register.field == *field)
                {
                    Some(register) => register,
                    None => {
                        registers.push(Register {
                            field: field.clone(),
                            wanted: Vec::new(),
                            block: Vec::new(),
                            found: Vec::new(),
                        });
                        registers.last_mut().expect("just pushed")
                    }
                };
                if !register.wanted.contains(name) {
                    register.wanted.push(name.clone());
                }
            }
        }
        let actions = compile(message, paths, &mut Vec::new(), &registers, true);
        Self { layout, actions, registers, epoch }
    }

    /// Writes the requested numbers of one message into `row`, which is initialised to NaN; `None`
    /// when the message ends before the last of them.
    pub(crate) fn run(&mut self, payload: &[u8], row: &mut [f64]) -> Option<()> {
        let mut cursor = Cursor::new(self.layout, payload)?;
        run(&self.actions, &mut cursor, &mut self.registers, self.epoch, row)
    }
}

/// The stamp at a path of fields, ns since the zero of its clock.
pub(crate) fn stamp(
    layout: Layout,
    message: &Struct,
    path: &[Step],
    payload: &[u8],
) -> Option<i64> {
    let mut cursor = Cursor::new(layout, payload)?;
    let mut at = message;
    for step in path {
        let Step::Field(place) = step else { return None };
        at.fields[..*place].iter().try_for_each(|field| cursor.pass_field(field))?;
        match &at.fields.get(*place)?.kind {
            Kind::Struct(inner) => at = inner,
            Kind::Stamp => return cursor.nanoseconds(),
            _ => return None,
        }
    }
    None
}

/// Actions for the fields of one struct, up to the last one needed if no later field is (`last`).
fn compile(
    message: &Struct,
    wanted: &[Wanted],
    at: &mut Vec<usize>,
    registers: &[Register],
    last: bool,
) -> Vec<Action> {
    let mut actions = Vec::new();
    let mut needed = 0;
    for (place, field) in message.fields.iter().enumerate() {
        at.push(place);
        let inner: Vec<Wanted> = wanted
            .iter()
            .filter(|(path, _)| path.first() == Some(&Step::Field(place)))
            .map(|(path, row)| (&path[1..], *row))
            .collect();
        let register = registers.iter().position(|register| register.field.0 == *at);
        // The following fields decide whether the inner struct may end early; skipping slightly
        // more does no harm.
        let action = match register {
            Some(register) => Action::Remember(field.arity, register),
            None if inner.is_empty() => Action::Pass(field.clone()),
            None => enter(field, &inner, at, registers),
        };
        at.pop();
        let is_needed = !matches!(action, Action::Pass(_));
        actions.push(action);
        if is_needed {
            needed = actions.len();
        }
    }
    if last {
        actions.truncate(needed);
    }
    actions
}

fn enter(field: &Field, wanted: &[Wanted], at: &mut Vec<usize>, registers: &[Register]) -> Action {
    match (&field.kind, field.arity) {
        (Kind::Struct(inner), Arity::One) => {
            Action::Enter(compile(inner, wanted, at, registers, false))
        }
        (Kind::Struct(inner), arity) => {
            let mut elements: Vec<usize> =
                wanted.iter().filter_map(|(path, _)| element(path)).collect();
            elements.sort_unstable();
            elements.dedup();
            let entered = elements.into_iter().map(|k| {
                let of_it: Vec<Wanted> = wanted
                    .iter()
                    .filter(|(path, _)| element(path) == Some(k))
                    .map(|(path, row)| (&path[1..], *row))
                    .collect();
                (k, compile(inner, &of_it, &mut vec![usize::MAX], registers, false))
            });
            Action::EnterSome(inner.clone(), arity, entered.collect())
        }
        (kind, Arity::One) => Action::Take(kind.clone(), wanted[0].1),
        (kind, arity) => {
            let picked = wanted
                .iter()
                .filter_map(|(path, row)| Some((pick(path.first()?, registers)?, *row)));
            Action::TakeSome(kind.clone(), arity, picked.collect())
        }
    }
}

fn element(path: &[Step]) -> Option<usize> {
    match path.first() {
        Some(Step::Element(k)) => Some(*k),
        _ => None,
    }
}

fn pick(step: &Step, registers: &[Register]) -> Option<Pick> {
    match step {
        Step::Field(_) => None,
        Step::Element(k) => Some(Pick::At(*k)),
        Step::Named(name, field) => {
            let register = registers.iter().position(|register| register.field == *field)?;
            let place = registers[register].wanted.iter().position(|wanted| wanted == name)?;
            Some(Pick::Named(register, place))
        }
    }
}

fn run(
    actions: &[Action],
    cursor: &mut Cursor,
    registers: &mut [Register],
    epoch: i64,
    row: &mut [f64],
) -> Option<()> {
    for action in actions {
        match action {
            Action::Pass(field) => cursor.pass_field(field)?,
            Action::Take(kind, to) => row[*to] = value(kind, cursor, epoch)?,
            Action::TakeSome(kind, arity, picks) => {
                take_some(kind, *arity, picks, cursor, registers, epoch, row)?
            }
            Action::Enter(actions) => run(actions, cursor, registers, epoch, row)?,
            Action::Remember(arity, register) => registers[*register].read(cursor, *arity)?,
            Action::EnterSome(inner, arity, picks) => {
                let mut picks = picks.iter().peekable();
                for k in 0..cursor.elements(*arity)? {
                    match picks.next_if(|(place, _)| *place == k) {
                        Some((_, actions)) => run(actions, cursor, registers, epoch, row)?,
                        None => cursor.pass_struct(inner)?,
                    }
                }
            }
        }
    }
    Some(())
}

fn take_some(
    kind: &Kind,
    arity: Arity,
    picks: &[(Pick, usize)],
    cursor: &mut Cursor,
    registers: &[Register],
    epoch: i64,
    row: &mut [f64],
) -> Option<()> {
    let count = cursor.elements(arity)?;
    let (size, words) = match kind {
        Kind::Number(storage) => (storage.size(), 1),
        _ => (4, 2),
    };
    let mut end = *cursor;
    end.pass(size, count.checked_mul(words)?)?;
    for (pick, to) in picks {
        let place = match pick {
            Pick::At(place) => Some(*place),
            Pick::Named(register, name) => registers[*register].found.get(*name).copied().flatten(),
        };
        if let Some(place) = place.filter(|place| *place < count) {
            let mut element = *cursor;
            element.pass(size, place * words)?;
            row[*to] = value(kind, &mut element, epoch)?;
        }
    }
    *cursor = end;
    Some(())
}

fn value(kind: &Kind, cursor: &mut Cursor, epoch: i64) -> Option<f64> {
    match kind {
        Kind::Number(storage) => cursor.number(*storage),
        Kind::Stamp => Some(seconds(cursor.nanoseconds()?.wrapping_sub(epoch))),
        Kind::Span => Some(seconds(cursor.nanoseconds()?)),
        Kind::Text | Kind::WideText | Kind::Struct(_) => None,
    }
}

/// The nearest number of seconds; exact to half a unit in the last place up to 104 days.
pub(crate) fn seconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e9
}

impl Register {
    fn read(&mut self, cursor: &mut Cursor, arity: Arity) -> Option<()> {
        cursor.align(4);
        let from = cursor.at;
        let rest = cursor.bytes.get(from..)?;
        if !self.block.is_empty() && rest.starts_with(&self.block) {
            cursor.at += self.block.len();
            return Some(());
        }
        let count = cursor.elements(arity)?;
        self.found.clear();
        self.found.resize(self.wanted.len(), None);
        for k in 0..count {
            let text = cursor.text()?;
            if let Some(place) = self.wanted.iter().position(|wanted| wanted.as_bytes() == text) {
                self.found[place].get_or_insert(k);
            }
        }
        self.block.clear();
        self.block.extend_from_slice(&cursor.bytes[from..cursor.at]);
        Some(())
    }
}
