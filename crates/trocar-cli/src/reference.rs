//! docs/reference/command-line.md: the help of every command as one page of the book.
//!
//! `TROCAR_WRITE_DOCS=1 cargo test -p trocar-cli --bin trocar reference` writes the page.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Arg, Command};

use crate::examples;

const HEAD: &str = "# Command line

Usage: `trocar [--quiet] COMMAND ...`. `trocar COMMAND --help` prints the same text with examples, `trocar man --out DIR` writes it as man pages,
and `trocar completions SHELL` completes commands and options in the shell.

Results go to standard output or into the file or folder of `--out`; progress, notes, warnings and errors go to standard
error. A file or folder appears whole or not at all. Every option carries its unit in its name or its description;
position and force are positive on insertion.

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | failed; the message names what, where, and the way out ([troubleshooting](../troubleshooting.md)) |
| 2 | bad arguments |
| 3 | done, but data were lost or the result is doubtful; the warnings name the reason, and the command below when it happens |
| 130 | interrupted with Ctrl-C; nothing unfinished remains |

The page is made from the program's own help.
";

fn page_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/command-line.md")
}

fn page() -> String {
    let mut command = examples::command();
    command.build();
    let mut text = HEAD.to_owned();
    let quiet = command.get_arguments().filter(|one| one.get_id() == "quiet");
    text += "\n## Options of all commands\n\n";
    quiet.for_each(|one| text += &entry(one));
    let verbs = leaves(&command, "");
    let mut entries: Vec<String> = Vec::new();
    verbs.iter().for_each(|(_, verb)| entries.extend(shown(verb).map(entry)));
    let is_shared = |own: &&String| entries.iter().filter(|one| one == own).count() >= SEVERAL;
    let mut shared: Vec<&String> = Vec::new();
    for own in entries.iter().filter(is_shared) {
        if !shared.contains(&own) {
            shared.push(own);
        }
    }
    text += "\n## Options of several commands\n\n";
    shared.iter().for_each(|own| text += own);
    verbs.iter().for_each(|(path, verb)| section(&mut text, verb, path, &shared));
    text
}

/// So many commands have an option in common that the page describes it once.
const SEVERAL: usize = 3;

/// The commands inside `command` that have no further ones, at all depths, with their paths.
fn leaves<'a>(command: &'a Command, path: &str) -> Vec<(String, &'a Command)> {
    let verbs = command.get_subcommands().filter(|verb| verb.get_name() != "help");
    let inner = verbs.flat_map(|verb| {
        let path = format!("{path} {}", verb.get_name()).trim().to_owned();
        if verb.has_subcommands() { leaves(verb, &path) } else { vec![(path, verb)] }
    });
    inner.collect()
}

/// Arguments and options of a command that the page shows.
fn shown(verb: &Command) -> impl Iterator<Item = &Arg> {
    verb.get_arguments()
        .filter(|one| !one.is_hide_set() && !["help", "quiet"].contains(&one.get_id().as_str()))
}

fn section(text: &mut String, verb: &Command, path: &str, shared: &[&String]) {
    // Writing to a String cannot fail, so the results are dropped.
    let _ = writeln!(text, "\n## trocar {path}\n");
    let about = verb.get_long_about().or(verb.get_about()).map(ToString::to_string);
    text.push_str(&prose(&about.unwrap_or_default()));
    let usage = verb.clone().render_usage().to_string();
    let usage: Vec<&str> = usage.trim_start_matches("Usage:").lines().map(str::trim).collect();
    let _ = writeln!(text, "\n```text\n{}\n```\n", usage.join("\n"));
    let (own, with_others): (Vec<&Arg>, Vec<&Arg>) =
        shown(verb).partition(|one| !shared.contains(&&entry(one)));
    own.into_iter().for_each(|one| *text += &entry(one));
    if !with_others.is_empty() {
        let name = |one: &Arg| format!("`{}`", written(one).split(' ').next().unwrap_or_default());
        let names: Vec<_> = with_others.into_iter().map(name).collect();
        let _ = writeln!(
            text,
            "- As [for several commands](#options-of-several-commands): {}.",
            names.join(", ")
        );
    }
}

/// Paragraphs of a help text, each on a line.
fn prose(help: &str) -> String {
    let paragraphs =
        help.split("\n\n").map(|one| one.split_whitespace().collect::<Vec<_>>().join(" "));
    paragraphs.map(|one| marked(&one)).collect::<Vec<_>>().join("\n\n") + "\n"
}

/// Words that are code, as code: options, names with units, files and keys. Text in backticks stays as it is.
fn marked(text: &str) -> String {
    let mut parts: Vec<String> = text.split('`').map(str::to_owned).collect();
    for plain in parts.iter_mut().step_by(2) {
        *plain = plain.split(' ').map(word).collect::<Vec<_>>().join(" ");
    }
    parts.join("`")
}

fn word(word: &str) -> String {
    let core = word.trim_matches(|letter: char| ",.;:()[]'".contains(letter));
    let is_code =
        core.starts_with("--") && core.len() > 2 || core.contains('_') || core.contains('*');
    match word.find(core) {
        Some(at) if is_code => {
            format!("{}`{core}`{}", &word[..at], &word[at + core.len()..])
        }
        _ => word.replace('<', "\\<").replace('[', "\\["),
    }
}

/// How an argument or option is written.
fn written(one: &Arg) -> String {
    let values = one.get_value_names().unwrap_or_default();
    let name = values.iter().map(|name| format!("<{name}>")).collect::<Vec<_>>().join(" ");
    match (one.get_long(), one.get_short()) {
        (Some(long), short) => {
            let short = short.map_or_else(String::new, |short| format!("-{short}, "));
            let takes_value = one.get_action().takes_values();
            format!(
                "{short}--{long}{}",
                if takes_value { format!(" {name}") } else { String::new() }
            )
        }
        (None, _) => name,
    }
}

/// An argument or option: how it is written, what it means, its default and its values.
fn entry(one: &Arg) -> String {
    let (written, takes_value) = (written(one), one.get_action().takes_values());
    let help = one.get_long_help().or(one.get_help()).map(ToString::to_string).unwrap_or_default();
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut text = format!("- **`{written}`**: {}.", marked(help.trim_end_matches('.')));
    if one.is_required_set() {
        text += " Required.";
    }
    let defaults: Vec<_> =
        one.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
    if takes_value && !defaults.is_empty() {
        let _ = write!(text, " Default: `{}`.", defaults.join(" "));
    }
    let possible = one.get_possible_values();
    let possible: Vec<_> = possible.iter().map(|value| format!("`{}`", value.get_name())).collect();
    if takes_value && !possible.is_empty() {
        let _ = write!(text, " One of {}.", possible.join(", "));
    }
    text + "\n"
}

#[test]
fn the_page_is_the_help_of_the_program() {
    let written = page();
    if std::env::var_os("TROCAR_WRITE_DOCS").is_some() {
        std::fs::create_dir_all(page_path().parent().expect("a folder")).expect("the folder");
        std::fs::write(page_path(), &written).expect("the page");
    }
    let kept = std::fs::read_to_string(page_path()).unwrap_or_default();
    let differs = written.lines().zip(kept.lines()).find(|(own, kept)| own != kept);
    assert!(
        written == kept,
        "docs/reference/command-line.md is not the program's help, first {differs:#?}\n\
         run TROCAR_WRITE_DOCS=1 cargo test -p trocar-cli --bin trocar reference"
    );
}

/// Whoever ends with exit code 3 says when.
#[test]
fn every_command_that_may_be_doubtful_says_when() {
    let verbs = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/verbs");
    let command = examples::command();
    let mut doubtful = 0;
    for entry in std::fs::read_dir(verbs).expect("the verbs") {
        let path = entry.expect("a verb").path();
        if !path.is_file()
            || !std::fs::read_to_string(&path).expect("a source").contains("doubtful_if(")
        {
            continue;
        }
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        let verb = command.find_subcommand(&name).expect("a file of the name of its command");
        let about = verb.get_long_about().expect("a description").to_string();
        let about = about.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(about.to_lowercase().contains("exit code 3"), "trocar {name}: {about}");
        doubtful += 1;
    }
    assert!(doubtful >= 10, "{doubtful} commands");
}
