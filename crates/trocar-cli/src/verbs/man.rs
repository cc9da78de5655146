//! `trocar man`

use clap::Command;
use clap_mangen::Man;
use trocar::output::StagedFolder;

use crate::output::Output;
use crate::{Completion, console, examples};

/// Print the man page or a page of the book, or write one man page per command into a folder
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Page of the book, as the help of a command names it
    #[arg(value_name = "PAGE", value_parser = PAGES.map(|(name, _)| name), conflicts_with = "out")]
    page: Option<String>,
    /// Folder for trocar.1 and one page per command
    #[arg(long, value_name = "DIR", value_parser = Output::folder(&["trocar*.1"]))]
    out: Option<Output>,
}

/// Pages of the book.
macro_rules! pages {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!("../../../../docs/", $name, ".md")))),*]
    };
}

/// Pages of the book on the commands, in the program, because where it runs there may be no sources.
const PAGES: [(&str, &str); 16] = pages![
    "index",
    "how-to/columns",
    "how-to/record",
    "how-to/fleet",
    "how-to/choose-model",
    "how-to/compensation",
    "how-to/teleoperation",
    "how-to/microcontroller",
    "how-to/values",
    "tutorials/first-identification",
    "explanation/validation",
    "explanation/seal",
    "start/simulator",
    "reference/published",
    "reference/fmu",
    "troubleshooting",
];

pub(crate) fn run(args: &Args) -> anyhow::Result<Completion> {
    if let Some(wanted) = &args.page {
        PAGES
            .iter()
            .filter(|(name, _)| name == wanted)
            .try_for_each(|(_, text)| console::print(&readable(text)))?;
        return Ok(Completion::Clean);
    }
    let mut command = examples::command();
    command.build();
    match &args.out {
        None => console::print(&String::from_utf8_lossy(&page(&command)?))?,
        Some(folder) => {
            let staged = StagedFolder::create(folder)?;
            staged.write("trocar.1", &page(&command)?)?;
            write_inner(&staged, &command, "trocar")?;
            staged.commit()?;
        }
    }
    Ok(Completion::Clean)
}

/// A page without what only makes the book: comments, contents, markup of its HTML.
fn readable(page: &str) -> String {
    let mut hidden = None;
    let lines = page.lines().filter_map(|line| {
        if let Some(end) = hidden {
            hidden = (line != end).then_some(end);
            return None;
        }
        hidden = match line {
            _ if line.starts_with("<!--") => (!line.ends_with("-->")).then_some("-->"),
            _ if line.starts_with("```{") => Some("```"),
            _ if line.starts_with(":") => {
                return line
                    .split_once("{grid-item-card} ")
                    .map(|(_, title)| format!("{title}:\n"));
            }
            _ => return Some(format!("{line}\n")),
        };
        None
    });
    lines.collect()
}

/// A page for each command inside `command`, at all depths.
fn write_inner(staged: &StagedFolder, command: &Command, name: &str) -> anyhow::Result<()> {
    for verb in command.get_subcommands().filter(|verb| verb.get_name() != "help") {
        let name = format!("{name}-{}", verb.get_name());
        staged.write(format!("{name}.1"), &page(verb)?)?;
        write_inner(staged, verb, &name)?;
    }
    Ok(())
}

fn page(command: &Command) -> std::io::Result<Vec<u8>> {
    let mut page = Vec::new();
    Man::new(command.clone()).render(&mut page)?;
    Ok(page)
}
