//! The pictures of the book: docs/figures/gallery with the page of them, the schematics in docs/figures, and the seal that moves on the first page.
//!
//! ```text
//! cargo run --release -p trocar --example gallery -- FOLDER [PICTURE ...]
//! ```
//! writes `FOLDER/figures/gallery/PICTURE.svg` for each picture named, `FOLDER/figures/PICTURE.svg` for a schematic, or all of them and the page
//! `FOLDER/gallery/index.md`. The seal is `moving-seal`, an HTML fragment. Everything is made anew from seeds, the same bytes every time.

use std::error::Error;
use std::path::Path;

use trocar::report::{Document, Figure, Section, vectors};
use trocar_model::ElementParams;

mod bench;
mod loops;
mod many;
mod moving_seal;
mod schematics;
mod seal;
mod sheet;
mod simulink;

use sheet::Sheet;

pub(crate) type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// The fragment with the seal that moves.
pub(crate) const MOVING: &str = "moving-seal";

/// Pictures that are made together: heading, names, and what makes them.
struct Group {
    heading: &'static str,
    names: &'static [&'static str],
    make: fn() -> Outcome<Vec<Figure>>,
}

/// All groups, in the order of the page.
const GROUPS: [Group; 7] = [
    Group { heading: "One seal", names: &seal::PICTURES, make: seal::figures },
    Group { heading: "Identification", names: &bench::IDENTIFIED, make: bench::identified },
    Group { heading: "Models side by side", names: &bench::COMPARED, make: bench::compared },
    Group { heading: "What the data leave open", names: &bench::DRAWN, make: bench::drawn },
    Group { heading: "Many seals", names: &many::PICTURES, make: many::figures },
    Group { heading: "A fleet of recordings", names: &many::FLEET, make: many::fleet },
    Group { heading: "Control", names: &loops::PICTURES, make: loops::figures },
];

/// Pictures of other commands: file in docs/figures, title, caption, command.
const OTHERS: [[&str; 4]; 4] = [
    [
        "compensation.svg",
        "Tissue force from outside the body",
        "A hand moves the instrument into tissue. The reading outside the body less the computed force of the trocar is the tissue force; while the seal is \
         wetted, the observer follows its friction scale: 0.038 N rms of error dry, 0.154 N wet ([beside published \
         errors](../explanation/compensation.md)).",
        "cargo run --release -p trocar --example compensation -- docs",
    ],
    [
        "stability-map.svg",
        "Where a loop is stable",
        "Stiffest tissue with which a position-force loop is stable, over the delay of the channel and the fraction of the trocar's force that is \
         compensated.",
        "cargo run --release -p trocar --example teleoperation -- docs",
    ],
    [
        "displayed-stiffness.svg",
        "Stiffness displayed",
        "Stiffness of the tissue as the operator feels it through seals of different friction, over the fraction compensated.",
        "cargo run --release -p trocar --example teleoperation -- docs",
    ],
    [
        "literal-reading.svg",
        "The literal reading",
        "Mode and branch by the sign of the velocity, as EMS is printed, beside the law of this project.",
        "cargo run --release -p trocar --example literal_reading -- docs",
    ],
];

/// A drawing: name of its file in docs/figures, title, caption, and what makes it.
struct Schematic {
    name: &'static str,
    title: &'static str,
    caption: &'static str,
    draw: fn() -> Outcome<Sheet>,
}

const SCHEMATICS: [Schematic; 6] = [
    Schematic {
        name: "trocar",
        title: "A trocar with a one-stage seal",
        caption: "Longitudinal section: the instrument slides in, reverses, takes the lip along until it snaps through, and slides out. The deflection z \
                  is where the lip touches the instrument, from where the lip is clamped; c is the half width.",
        draw: schematics::trocar,
    },
    Schematic {
        name: "ems-element",
        title: "The EMS element",
        caption: "One stage of a seal, and the element that stands for it: a nonlinear spring and a damper carry the contact A on which the instrument \
                  slides; O is fixed, B is a point of the instrument.",
        draw: schematics::ems_element,
    },
    Schematic {
        name: "maxwell-slip",
        title: "The Maxwell-Slip model",
        caption: "Springs in series with blocks that slide at a limit force; all are moved at one velocity, and their forces add up with that of a damper.",
        draw: schematics::maxwell_slip,
    },
    Schematic {
        name: "test-bench",
        title: "The test bench",
        caption: "A linear motor with an encoder moves a rod through a fixed trocar; a force sensor lies between motor and rod. Drawn lying; the bench of the \
                  paper stands upright, so that the weight of the rod adds to the offset of the force.",
        draw: schematics::test_bench,
    },
    Schematic {
        name: "simulink-ports",
        title: "Ports of the C Caller block",
        caption: "Port specification of the block with the exported seal.",
        draw: simulink::ports,
    },
    Schematic {
        name: "simulink-model",
        title: "The C Caller block in a model",
        caption: "The block takes the sampled position of the plant and returns the force of the seal, which acts against the motion.",
        draw: simulink::model,
    },
];

/// Names of all pictures.
pub(crate) fn names() -> impl Iterator<Item = &'static str> {
    let figures = GROUPS.iter().flat_map(|group| group.names).copied();
    figures.chain(SCHEMATICS.iter().map(|schematic| schematic.name))
}

/// Name and SVG of the schematics of `wanted`, or all.
pub(crate) fn schematics(wanted: &[String]) -> Outcome<Vec<(&'static str, String)>> {
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|own| own == name);
    let wanted = SCHEMATICS.iter().filter(|schematic| is_wanted(schematic.name));
    wanted.map(|s| Ok((s.name, (s.draw)()?.svg(s.name, s.title, s.caption)))).collect()
}

/// The figures of `wanted`, or all.
pub(crate) fn figures(wanted: &[String]) -> Outcome<Vec<Figure>> {
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|own| own == name);
    let mut figures = Vec::new();
    for Group { names, make, .. } in &GROUPS {
        if names.iter().any(|name| is_wanted(name)) {
            let made = make()?;
            let made_names: Vec<&str> = made.iter().map(|figure| figure.id.as_str()).collect();
            if made_names != *names {
                return Err(format!("{made_names:?} were made, not {names:?}").into());
            }
            figures.extend(made.into_iter().filter(|figure| is_wanted(&figure.id)));
        }
    }
    Ok(figures)
}

/// Name and SVG of each figure.
pub(crate) fn drawn(figures: &[Figure]) -> Outcome<Vec<(String, String)>> {
    let sections = figures.iter().map(|figure| Section::new("").figure(figure.clone())).collect();
    Ok(vectors(&Document { sections, ..Document::default() })?)
}

/// The page: all pictures small, then each with its words, and its command if that is another one.
pub(crate) fn page(figures: &[Figure]) -> String {
    let (mut small, mut large) = (String::new(), String::new());
    let mut all = figures.iter();
    for group in &GROUPS {
        large += &format!("## {}\n\n", group.heading);
        for figure in all.by_ref().take(group.names.len()) {
            let file = format!("gallery/{}.svg", figure.id);
            let [thumbnail, entry] = entry([&file, &figure.title, beginning(&figure.caption), ""]);
            small += &thumbnail;
            large += &entry;
        }
    }
    for [thumbnail, entry] in OTHERS.map(entry) {
        small += &thumbnail;
        large += &entry;
    }
    large += "## Schematics\n\n";
    for Schematic { name, title, caption, .. } in &SCHEMATICS {
        let file = format!("{name}.svg");
        let [thumbnail, entry] = entry([&file, title, caption, ""]);
        small += &thumbnail;
        large += &entry;
    }
    format!(
        "# Gallery\n\n<!-- made by: {COMMAND} -->\n\nAll pictures come from the models, the virtual bench and the reports of this project. This command makes \
         them, or the one whose file name without its extension follows; other commands are below their pictures:\n\n```text\n{COMMAND}\n```\n\n::::{{grid}} 2 3 4 4\n:gutter: 2\n:class-container: thumbnails\n\n{small}::::\n\n{large}"
    )
}

const COMMAND: &str = "cargo run --release -p trocar --example gallery -- docs";

/// Words of a caption on the page; the picture itself holds all of it.
const MOST_WORDS: usize = 35;

/// The first sentences of a caption.
fn beginning(caption: &str) -> &str {
    let mut end = caption.len();
    for (at, _) in caption.rmatch_indices(". ") {
        if caption[..end].split_whitespace().count() > MOST_WORDS {
            end = at + 1;
        }
    }
    &caption[..end]
}

/// A picture small, with a link to where it is large, and that place.
fn entry([file, title, caption, command]: [&str; 4]) -> [String; 2] {
    let kept = |c: char| c.is_alphanumeric() || c == ' ' || c == '-';
    let anchor = title.to_lowercase().replace(|c| !kept(c), "").replace(' ', "-");
    let picture = format!("![{title}](../figures/{file})");
    let command = if command.is_empty() { String::new() } else { format!("`{command}`\n\n") };
    [
        format!(":::{{grid-item}}\n[{picture}](#{anchor})\n:::\n"),
        format!("### {title}\n\n{picture}\n\n{caption}\n\n{command}"),
    ]
}

/// The seal of the first page.
pub(crate) fn moving() -> Outcome<String> {
    moving_seal::moving_seal(&ElementParams::plausible_10_5_mm()?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("the folder for the pictures is missing")?;
    let wanted: Vec<String> = arguments.collect();
    if let Some(name) = wanted.iter().find(|name| **name != MOVING && !names().any(|n| n == **name))
    {
        let all: Vec<&str> = names().collect();
        return Err(format!("there is no picture {name}, only {MOVING}, {}", all.join(", ")).into());
    }
    write(Path::new(&folder), &wanted).map_err(|error| -> Box<dyn Error> { error })
}

fn write(folder: &Path, wanted: &[String]) -> Outcome<()> {
    let pictures = folder.join("figures/gallery");
    std::fs::create_dir_all(&pictures)?;
    if wanted.is_empty() || wanted.iter().any(|name| name == MOVING) {
        std::fs::write(pictures.join(MOVING).with_extension("html"), moving()?)?;
    }
    for (name, svg) in schematics(wanted)? {
        std::fs::write(folder.join("figures").join(name).with_extension("svg"), svg)?;
    }
    let figures = figures(wanted)?;
    for (name, svg) in drawn(&figures)? {
        std::fs::write(pictures.join(name).with_extension("svg"), svg)?;
    }
    if wanted.is_empty() {
        std::fs::create_dir_all(folder.join("gallery"))?;
        std::fs::write(folder.join("gallery/index.md"), page(&figures))?;
    }
    Ok(())
}

/// Every `step`th value, in another unit.
pub(crate) fn thinned(values: &[f64], step: usize, scale: f64) -> Vec<f64> {
    values.iter().step_by(step).map(|value| scale * value).collect()
}

/// The figures of a document by their ids, with the names they have here.
pub(crate) fn chosen(document: Document, ids: &[(&str, &str)]) -> Outcome<Vec<Figure>> {
    let mut figures: Vec<Figure> =
        document.sections.into_iter().flat_map(|section| section.figures).collect();
    ids.iter()
        .map(|(id, name)| {
            let at = figures.iter().position(|figure| figure.id == *id);
            let mut figure = figures.swap_remove(at.ok_or_else(|| format!("no figure {id}"))?);
            figure.id = (*name).to_owned();
            Ok(figure)
        })
        .collect()
}
