//! Examples of every command, for its help and its man page.

use clap::{Command, CommandFactory};

use crate::Cli;

/// A section a command: its name, its page of the book (one of those that `trocar man` prints), and command lines, most below a
/// line of their purpose.
const EXAMPLES: &str = include_str!("../data/examples.txt");

/// Examples in the short help of a command.
const FIRST: usize = 2;

/// The command line with the examples in its help: the first ones in the short one.
pub(crate) fn command() -> Command {
    sections().fold(Cli::command(), |all, (path, page, lines)| {
        let parts: Vec<&str> = path.split(' ').collect();
        let [short, long] = [FIRST, usize::MAX]
            .map(|most| format!("{}\n\nRead on: trocar man {page}", text(lines, most)));
        with_text(all, &parts, &short, &long)
    })
}

/// The name of each command, its page and its lines.
fn sections() -> impl Iterator<Item = (&'static str, &'static str, &'static str)> {
    EXAMPLES.split("\n\n").map(|section| {
        let (head, lines) = section.split_once('\n').expect("a head and lines");
        let (path, page) = head.split_once(": ").expect("a command and a page");
        (path, page, lines)
    })
}

fn with_text(command: Command, path: &[&str], short: &str, long: &str) -> Command {
    match path {
        [] => command.after_help(short.to_owned()).after_long_help(long.to_owned()),
        [verb, rest @ ..] => command.mut_subcommand(verb, |own| with_text(own, rest, short, long)),
    }
}

/// At most so many examples.
fn text(lines: &str, most: usize) -> String {
    let mut left = most;
    let shown = lines.lines().take_while(|line| {
        let is_shown = left > 0;
        left -= usize::from(is_shown && is_command(line));
        is_shown
    });
    format!("Examples:{}", shown.map(|line| format!("\n  {line}")).collect::<String>())
}

fn is_command(line: &str) -> bool {
    !line.starts_with('#')
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of a screen.
    const MOST_LINES: usize = 45;

    /// Words of a line up to a redirection or a pipe.
    fn words(line: &str) -> impl Iterator<Item = &str> {
        line.split_whitespace().take_while(|word| !matches!(*word, ">" | "|"))
    }

    #[test]
    fn every_example_is_a_valid_command_line() {
        for (path, _, lines) in sections() {
            for line in lines.lines().filter(|line| is_command(line)) {
                let parsed = command().try_get_matches_from(words(line));
                assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
                assert!(line.starts_with(&format!("trocar {path}")), "{line} is none of {path}");
            }
        }
    }

    #[test]
    fn every_command_names_a_page_that_the_program_prints() {
        for (path, page, _) in sections() {
            let parsed = command().try_get_matches_from(["trocar", "man", page]);
            assert!(parsed.is_ok(), "{path}: {}", parsed.unwrap_err());
        }
    }

    #[test]
    fn the_short_help_fits_a_screen() {
        for verb in ["identify", "compare", "fleet", "plan"] {
            let mut own =
                command().find_subcommand(verb).expect("the command").clone().term_width(100);
            let (short, long) = (own.render_help().to_string(), own.render_long_help().to_string());
            assert!(short.lines().count() <= MOST_LINES, "{verb}: {short}");
            let options = own.get_arguments().filter_map(clap::Arg::get_long);
            options.for_each(|name| assert!(long.contains(&format!("--{name}")), "{verb} {name}"));
            assert!(short.contains("see more with '--help'"), "{verb}: {short}");
        }
    }

    #[test]
    fn every_command_has_examples() {
        fn check(command: &Command) {
            let mut inner =
                command.get_subcommands().filter(|own| own.get_name() != "help").peekable();
            if inner.peek().is_none() {
                let help = command.clone().render_help().to_string();
                assert!(help.contains("Examples:"), "{}", command.get_name());
            }
            inner.for_each(check);
        }
        check(&command());
    }
}
