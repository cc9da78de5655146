//! Draws as a table, and the models of a table of draws.

use std::path::{Path, PathBuf};

use trocar_model::{
    DeformationForce, Direction, MAX_DEGREE, ParamError, ParameterId, Piece, Quantity, Relaxation,
    RelaxationArm, SlidingFriction, Stages,
};

use super::super::candidate::Candidate;
use super::super::shape::BranchShape;
use super::super::stage::SecondStage;
use super::{Draw, Posterior};
use trocar_tables::error::{OutputError, TableError};
use trocar_tables::table::{self, Column, Field, Table, TableWriter};

/// Name of the file of draws in the folder of a result.
pub const FILE_NAME: &str = "posterior.parquet";

/// Columns before those of the parameters.
const HEAD: [&str; 3] = ["chain", "draw", "structure"];

/// Why a table holds no draws.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DrawsError {
    /// The table cannot be read.
    #[error(transparent)]
    Table(#[from] TableError),
    /// Other columns, or no rows.
    #[error("{}: {found}, expected draws\n\nhint: trocar identify --posterior N writes them into its folder, as {FILE_NAME}", path.display())]
    NoDraws {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
    },
    /// A row whose parameters form no model.
    #[error("draws, row {row}: {source}")]
    Row {
        /// Row, from 1.
        row: usize,
        /// What is wrong.
        source: ParamError,
    },
}

impl Posterior {
    /// The draws as a table: `chain`, `draw`, `structure`, and the parameters by name with unit.
    #[must_use]
    pub fn table(&self) -> Table {
        let whole = |of: fn(&Draw) -> usize| {
            Column::Integer(self.draws.iter().map(|d| i64::try_from(of(d)).ok()).collect())
        };
        let name = |d: &Draw| Some(self.structures[d.structure].name.clone().into());
        let number = |j: usize| Column::Number(self.draws.iter().map(|d| d.values[j]).collect());
        let structure = Column::Text(self.draws.iter().map(name).collect());
        let head = [whole(|d| d.chain), whole(|d| d.draw), structure];
        let names = self.parameters.iter().map(|p| p.id.to_string());
        Table {
            fields: HEAD.into_iter().map(str::to_owned).chain(names).collect(),
            columns: head.into_iter().chain((0..self.parameters.len()).map(number)).collect(),
        }
    }

    /// Writes the draws; the extension of `path` selects the format.
    ///
    /// # Errors
    /// [`OutputError`] when the file cannot be written; nothing is left of it then.
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        write(&self.table(), path)
    }
}

/// Writes a table of draws; the extension of `path` selects the format.
///
/// # Errors
/// [`OutputError`] when the file cannot be written; nothing is left of it then.
pub fn write(table: &Table, path: &Path) -> Result<(), OutputError> {
    let field = |(name, column): (&String, &Column)| Field::new(name.clone(), column.kind());
    let fields: Vec<Field> = table.fields.iter().zip(&table.columns).map(field).collect();
    let mut writer = TableWriter::create(path, &fields)?;
    writer.write(&table.columns)?;
    writer.commit()
}

/// The table of draws in a Parquet file that [`Posterior::write`] wrote.
///
/// # Errors
/// [`DrawsError`] when the file is no table of draws.
pub fn read(path: &Path) -> Result<Table, DrawsError> {
    let table = table::read(path)?;
    let parameters = [Quantity::CoulombForce, Quantity::ViscousDamping, Quantity::HalfWidth]
        .map(|quantity| quantity.id().to_string());
    let needed = HEAD.into_iter().chain(parameters.iter().map(String::as_str));
    let missing = needed.into_iter().find(|name| table.column(name).is_none());
    let found = match missing {
        Some(name) => format!("no column {name}"),
        None if table.rows() == 0 => "no rows".to_owned(),
        None => return Ok(table),
    };
    Err(DrawsError::NoDraws { path: path.to_owned(), found })
}

/// The elements of all draws of a table.
///
/// # Errors
/// [`DrawsError::Row`] for parameters that form no element.
pub fn models(table: &Table) -> Result<Vec<Stages>, DrawsError> {
    let rows = Rows::new(table);
    let model = |row: usize| {
        let candidate = rows.candidate(row).and_then(|candidate| candidate.stages());
        candidate.map_err(|source| DrawsError::Row { row: row + 1, source })
    };
    (0..table.rows()).map(model).collect()
}

/// The elements of the draws in a file that [`Posterior::write`] wrote, in the order of its rows.
///
/// # Errors
/// As for [`read`] and [`models`].
pub fn read_models(path: &Path) -> Result<Vec<Stages>, DrawsError> {
    models(&read(path)?)
}

/// The columns of parameters of a table of draws.
struct Rows<'a> {
    columns: Vec<(ParameterId, &'a [f64])>,
}

impl<'a> Rows<'a> {
    fn new(table: &'a Table) -> Self {
        let of = |(name, column): (&String, &'a Column)| match column {
            Column::Number(cells) => Some((name.parse().ok()?, cells.as_slice())),
            _ => None,
        };
        Self { columns: table.fields.iter().zip(&table.columns).filter_map(of).collect() }
    }

    /// The value in a row; `None` where the structure of that draw does not have it.
    fn get(&self, row: usize, id: ParameterId) -> Option<f64> {
        let (_, cells) = self.columns.iter().find(|(own, _)| *own == id)?;
        Some(cells[row]).filter(|value| value.is_finite())
    }

    /// The candidate of a row: the inverse of `Candidate::value`.
    fn candidate(&self, row: usize) -> Result<Candidate, ParamError> {
        use Quantity as Q;
        let get = |quantity: Quantity| self.get(row, quantity.id());
        let or = |quantity: Quantity, other: f64| get(quantity).unwrap_or(other);
        let whole = or(Q::CoulombForce, f64::NAN);
        let of_second = self.get(row, Q::CoulombForce.id().of_element(1));
        let share = of_second.map(|own| own / (whole - own));
        let factor = 1.0 + share.unwrap_or(0.0);
        let [insertion, withdrawal] = Direction::BOTH.map(|direction| {
            let by = |quantity: Quantity| self.get(row, quantity.of(direction)).or(get(quantity));
            let coulomb = by(Q::CoulombForce).unwrap_or(f64::NAN) / factor;
            SlidingFriction {
                coulomb_force: coulomb,
                static_force: by(Q::StaticForce).map_or(coulomb, |force| force / factor),
                stribeck_velocity: or(Q::StribeckVelocity, 0.01),
                stribeck_exponent: or(Q::StribeckExponent, 2.0),
                viscous_damping: by(Q::ViscousDamping).unwrap_or(0.0) / factor,
            }
        });
        let half_width = or(Q::HalfWidth, f64::NAN);
        let [insertion_branch, withdrawal_branch] =
            Direction::BOTH.map(|direction| self.branch(row, None, direction, half_width));
        let arm = |stiffness: Quantity, time: Quantity| RelaxationArm {
            stiffness: or(stiffness, 0.0),
            time: or(time, 1.0),
        };
        let arms = [
            arm(Q::RelaxationStiffness, Q::RelaxationTime),
            arm(Q::SecondRelaxationStiffness, Q::SecondRelaxationTime),
        ];
        let mut candidate = Candidate {
            offset: or(Q::Offset, 0.0),
            unmodelled_mass: or(Q::UnmodelledMass, 0.0),
            insertion,
            withdrawal,
            half_width,
            insertion_branch,
            withdrawal_branch,
            seal_damping: or(Q::SealDamping, 0.0) / factor,
            yield_ratio: Candidate::DEFAULT_YIELD_RATIO,
            creep_velocity: or(Q::CreepVelocity, 0.0),
            friction_lag: or(Q::FrictionLag, 0.0),
            relaxation: Relaxation { arms },
            second: share.map(|share| self.second(row, share)),
        };
        if let Some(stiffness) = get(Q::YieldStiffness) {
            let ends = candidate.end_forces();
            let [a, b] = Direction::BOTH
                .map(|direction| candidate.branch(direction).branch(half_width, ends));
            let softest = DeformationForce::new(a?, b?, None)?.yield_stiffness();
            candidate.yield_ratio *= stiffness / softest;
        }
        Ok(candidate)
    }

    fn second(&self, row: usize, share: f64) -> SecondStage {
        let width = self.get(row, Quantity::HalfWidth.id().of_element(1)).unwrap_or(f64::NAN);
        let [insertion_branch, withdrawal_branch] =
            Direction::BOTH.map(|direction| self.branch(row, Some(1), direction, width));
        SecondStage { share, half_width: width, insertion_branch, withdrawal_branch }
    }

    fn branch(
        &self,
        row: usize,
        element: Option<usize>,
        direction: Direction,
        half_width: f64,
    ) -> BranchShape {
        let of = |quantity: Quantity| {
            let id = quantity.of(direction);
            self.get(row, element.map_or(id, |index| id.of_element(index)))
        };
        let join = of(Quantity::Join).unwrap_or(f64::NAN);
        let coefficients = |piece: u8| -> Vec<f64> {
            let powers = 0..=MAX_DEGREE as u8;
            powers.map_while(|power| of(Quantity::Coefficient { piece, power })).collect()
        };
        BranchShape {
            join: join / half_width,
            join_force: of(Quantity::JoinForce).unwrap_or(f64::NAN),
            left: curvature(&coefficients(1), -half_width, join),
            right: curvature(&coefficients(2), join, half_width),
        }
    }
}

/// Legendre coefficients of order 2 and up, over [low, high], of a polynomial in powers of z.
fn curvature(monomial: &[f64], low: f64, high: f64) -> Vec<f64> {
    let piece = Piece::from_monomial(low, high, monomial);
    piece
        .map_or_else(|_| Vec::new(), |piece| piece.legendre().get(2..).unwrap_or_default().to_vec())
}
