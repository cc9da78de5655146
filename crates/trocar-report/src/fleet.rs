//! Creates a report from the table of many recordings.

use super::document::{Document, Section, Tile};
use super::figures::fleet as figures;
use super::figures::fleet::{ByType, Shown};
use trocar_lab::fleet::{Config, Fleet, FleetCell};
use trocar_lab::summary::PROGRAM;
use trocar_model::Quantity;

/// Metadata columns for the comparisons of the report; those not given are found by their usual
/// names.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Roles {
    /// Type of the trocar.
    pub kind: Option<String>,
    /// Use: number of insertions or similar.
    pub usage: Option<String>,
    /// Specimen or another grouping, such as the centre: each has a level of its own.
    pub specimen: Option<String>,
}

/// Usual names.
const KINDS: [&str; 4] = ["trocar_type", "trocar", "seal_type", "type"];
const USAGES: [&str; 5] = ["insertion_count", "insertions", "use_count", "uses", "cycles"];
const SPECIMENS: [&str; 5] = ["specimen", "serial_number", "serial", "seal", "centre"];

impl Roles {
    /// These columns, if `fleet` has them, else columns of the usual names.
    fn settle(&self, fleet: &Fleet) -> Self {
        let has = |name: &str| {
            fleet
                .records
                .iter()
                .any(|r| r.metadata.get(name).is_some_and(|c| *c != FleetCell::Empty))
        };
        let found = |given: &Option<String>, usual: &[&str], fits: &dyn Fn(&str) -> bool| {
            let usual = usual.iter().map(|name| (*name).to_owned());
            given.iter().cloned().chain(usual).find(|name| fits(name))
        };
        Self {
            kind: found(&self.kind, &KINDS, &has),
            usage: found(&self.usage, &USAGES, &|name| {
                fleet
                    .records
                    .iter()
                    .any(|r| r.metadata.get(name).is_some_and(|c| c.as_number().is_some()))
            }),
            specimen: found(&self.specimen, &SPECIMENS, &has),
        }
    }
}

/// The report: counts, distributions, drift with use, outliers, failures.
///
/// Equal input gives equal documents. Where metadata are missing, a sentence says what is missing.
pub fn document(fleet: &Fleet, config: &Config, roles: &Roles) -> Document {
    let roles = roles.settle(fleet);
    let types = ByType::new(fleet, roles.kind.as_deref());
    Document {
        title: "Trocar friction over many recordings".to_owned(),
        subtitle: subtitle(fleet, config, &roles),
        card: Vec::new(),
        tiles: tiles(fleet),
        warnings: Vec::new(),
        notes: Vec::new(),
        sections: vec![
            Section::new("Distributions").figure(figures::distributions(&types)),
            drift(&types, &roles),
            outliers(&types),
            failures(fleet),
        ],
        provenance: provenance(fleet, config),
    }
    .numbered()
}

fn subtitle(fleet: &Fleet, config: &Config, roles: &Roles) -> String {
    let by = roles
        .kind
        .as_ref()
        .map_or_else(String::new, |kind| format!(", by {}", kind.replace('_', " ")));
    format!(
        "{} recordings, each identified by itself (depth {}){by}",
        fleet.tally.done,
        config.depth.name()
    )
}

fn tiles(fleet: &Fleet) -> Vec<Tile> {
    let doubtful =
        format!("{} more with doubts, {} failed", fleet.count("doubtful"), fleet.count("failed"));
    let mut tiles = vec![
        Tile::new("Identified without doubt", fleet.count("ok").to_string(), doubtful),
        Tile::new("Samples", format!("{:.1} million", 1e-6 * fleet.tally.samples as f64), ""),
    ];
    let parameters = [Quantity::CoulombForce, Quantity::HalfWidth]
        .map(|quantity| Shown::Parameter(quantity.id()));
    for shown in parameters.into_iter().chain([Shown::Residual]) {
        if let Some([median, low, high]) = figures::median_in_words(fleet, shown) {
            let value = format!("{median} {}", shown.unit().shown);
            tiles.push(Tile::new(
                shown.name(),
                value,
                format!("median; quartiles {low} and {high}"),
            ));
        }
    }
    tiles
}

fn drift(types: &ByType, roles: &Roles) -> Section {
    let section = Section::new("Drift with use");
    let Some(usage) = &roles.usage else {
        return section.paragraph(
            "No column of the data set counts uses (insertion_count, or another named with ‹use›).",
        );
    };
    match figures::drift(types, usage, roles.specimen.as_deref()) {
        Some((figure, table)) => section.table(table).figure(figure),
        None => section.paragraph(format!("Too few recordings at different values of {usage}.")),
    }
}

fn outliers(types: &ByType) -> Section {
    let (count, table) = figures::outliers(types);
    let section = Section::new("Outliers").paragraph(format!(
        "Modified score 0.6745·(value − median)/MAD within the type, MAD the median absolute deviation; beyond 3.5 a value is called an \
         outlier: {count} of them. About one in two thousand values of a normal distribution would be."
    ));
    if count == 0 { section } else { section.table(table) }
}

fn failures(fleet: &Fleet) -> Section {
    let section = Section::new("Failures");
    match figures::failures(fleet) {
        Some(table) => section.table(table),
        None => section.paragraph("No recording failed."),
    }
}

fn provenance(fleet: &Fleet, config: &Config) -> Vec<(String, String)> {
    vec![
        ("Program".to_owned(), PROGRAM.to_owned()),
        ("Configuration".to_owned(), config.hash()),
        ("Seed".to_owned(), config.seed.to_string()),
        (
            "Recordings".to_owned(),
            format!("{}; each with its SHA-256 in the table", fleet.tally.done),
        ),
    ]
}
