//! Examples of every command, for its help and its man page.

use clap::{Command, CommandFactory};

use crate::Cli;

/// Command, and lines of a purpose and a command line.
type Example = (&'static str, &'static [(&'static str, &'static str)]);

pub(crate) const EXAMPLES: [Example; 18] = [
    (
        "inspect",
        &[
            ("What is in a file, and which columns would be used", "trocar inspect recording.csv"),
            ("The topics of a robot log", "trocar inspect session.mcap"),
        ],
    ),
    (
        "bench",
        &[
            (
                "The paper's steady cycles with a made-up seal",
                "trocar bench steady --out steady.csv",
            ),
            (
                "A rig of your own: change the file, then record with it",
                "trocar bench --print-config",
            ),
            ("", "trocar bench surgeon --rig rig.toml --seal model.json --out surgeon.csv"),
            (
                "A seal whose friction lies within published ranges, by the seed",
                "trocar bench steady --like dobbelsteen-2007 --seed 3 --out steady.csv",
            ),
            (
                "A motion of your own or of `trocar plan`",
                "trocar bench --motion motion.csv --out planned.csv",
            ),
        ],
    ),
    (
        "identify",
        &[
            ("From one recording", "trocar identify steady.csv --out result"),
            (
                "From two, validated on others",
                "trocar identify steady.csv dynamic.csv --validate surgeon.csv --out result",
            ),
            (
                "With 2000 draws of the parameters from their posterior, in result/posterior.parquet",
                "trocar identify steady.csv dynamic.csv --posterior 2000 --out result",
            ),
            (
                "A few strokes in the trocar in use, and a model of one of the same type",
                "trocar identify strokes.csv --prior result/model.json --out in-use",
            ),
            (
                "Columns with other names, and a sensor that carries a mass of 40 g",
                "trocar identify log.csv --columns time_s=t,position_mm=pos,force_n=Fz --moving-mass-kg 0.04 --out result",
            ),
        ],
    ),
    (
        "fleet",
        &[
            ("Every recording of a folder", "trocar fleet recordings --out fleet.parquet"),
            ("The files of a list", "trocar fleet list.csv --out fleet.csv"),
        ],
    ),
    (
        "validate",
        &[
            (
                "The error of a model on recordings it has not seen",
                "trocar validate result surgeon.csv",
            ),
            ("As JSON", "trocar validate result surgeon.csv --json"),
        ],
    ),
    (
        "compare",
        &[
            ("The best model of each family", "trocar compare steady.csv --validate surgeon.csv"),
            (
                "Some models, with a report",
                "trocar compare steady.csv --models ems,lugre,gms:4-10 --out compared",
            ),
        ],
    ),
    (
        "simulate",
        &[
            ("The force along a motion", "trocar simulate result motion.csv --out force.csv"),
            ("In a pipe", "trocar simulate result - --out -"),
        ],
    ),
    (
        "compensate",
        &[
            (
                "The tissue force from a sensor outside the body",
                "trocar compensate result recording.csv --out tissue.csv",
            ),
            ("Row by row, as a sensor sends them", "trocar compensate result - --out -"),
            (
                "With the error of the parameters from posterior draws",
                "trocar compensate result recording.csv --posterior result/posterior.parquet --out tissue.csv",
            ),
        ],
    ),
    (
        "plan",
        &[
            ("One minute that tells most about an unknown seal", "trocar plan --out motion.csv"),
            (
                "What to record next to know the viscous damping within 5 %",
                "trocar plan --model result --after steady.csv --for viscous_damping_n_s_m:5% --out next.csv",
            ),
            ("The rig, its noise and the seals that are expected", "trocar plan --print-config"),
        ],
    ),
    (
        "ranges",
        &[
            ("What the literature prints, and from where", "trocar ranges"),
            ("One study, and the seals drawn from it", "trocar ranges imeche-2015"),
        ],
    ),
    (
        "teleop",
        &[
            ("The loop of a dVRK with a made-up seal", "trocar teleop dvrk"),
            ("A loop of your own: change the file, then run it", "trocar teleop --print-config"),
            ("The same of a device", "trocar teleop --print-config dvrk"),
            ("", "trocar teleop loop.toml --model result --out looked-at"),
            (
                "How much of the trocar's force to compensate",
                "trocar teleop loop.toml --model result --advise",
            ),
        ],
    ),
    ("analyze", &[("The paper's propositions for a model", "trocar analyze result")]),
    (
        "export c",
        &[
            (
                "trocar_seal.c and trocar_seal.h for a microcontroller",
                "trocar export c result --out trocar_seal.c",
            ),
            (
                "For one without double precision, such as a Cortex-M4F",
                "trocar export c result --out trocar_seal.c --precision single",
            ),
            (
                "With the observer of the tissue force",
                "trocar export c result --out trocar_seal.c --compensator --moving-mass-kg 0.2",
            ),
        ],
    ),
    (
        "export fmu",
        &[
            ("For most simulation programs", "trocar export fmu result --out seal.fmu"),
            (
                "FMI 3.0, driven by the position at the end of each step",
                "trocar export fmu result --fmi 3 --input position --out seal.fmu",
            ),
            (
                "As source code, for platforms without a library",
                "trocar export fmu result --source --out seal.fmu",
            ),
        ],
    ),
    (
        "export values",
        &[
            ("F_c and β as MuJoCo calls them", "trocar export values result --for mujoco"),
            (
                "What these numbers lose, on a recording held out",
                "trocar export values result --for urdf --validate surgeon.csv",
            ),
        ],
    ),
    ("demo", &[("Record, identify, validate and report", "trocar demo --out trocar-demo")]),
    (
        "completions",
        &[
            (
                "bash: for this user",
                "trocar completions bash > ~/.local/share/bash-completion/completions/trocar",
            ),
            ("zsh: into a folder of $fpath", "trocar completions zsh > ~/.zfunc/_trocar"),
            ("fish", "trocar completions fish > ~/.config/fish/completions/trocar.fish"),
        ],
    ),
    (
        "man",
        &[
            ("Read the page", "trocar man | man -l -"),
            ("Read a page of the book", "trocar man how-to/columns"),
            ("Install all pages", "trocar man --out ~/.local/share/man/man1"),
        ],
    ),
];

/// Page of the book on a command, one of those that `trocar man` prints.
fn page(path: &str) -> &'static str {
    match path {
        "inspect" => "how-to/columns",
        "plan" | "bench" => "how-to/record",
        "identify" => "tutorials/first-identification",
        "fleet" => "how-to/fleet",
        "validate" => "explanation/validation",
        "compare" => "how-to/choose-model",
        "simulate" => "start/simulator",
        "compensate" => "how-to/compensation",
        "ranges" => "reference/published",
        "teleop" => "how-to/teleoperation",
        "analyze" => "explanation/seal",
        "export c" => "how-to/microcontroller",
        "export fmu" => "reference/fmu",
        "export values" => "how-to/values",
        _ => "index",
    }
}

/// Examples in the short help of a command.
const FIRST: usize = 2;

/// The command line with the examples in its help: the first ones in the short one.
pub(crate) fn command() -> Command {
    EXAMPLES.iter().fold(Cli::command(), |all, (path, examples)| {
        let parts: Vec<&str> = path.split(' ').collect();
        let [short, long] = [&examples[..examples.len().min(FIRST)], examples]
            .map(|own| format!("{}\n\nRead on: trocar man {}", text(own), page(path)));
        with_text(all, &parts, &short, &long)
    })
}

fn with_text(command: Command, path: &[&str], short: &str, long: &str) -> Command {
    match path {
        [] => command.after_help(short.to_owned()).after_long_help(long.to_owned()),
        [verb, rest @ ..] => command.mut_subcommand(verb, |own| with_text(own, rest, short, long)),
    }
}

fn text(examples: &[(&str, &str)]) -> String {
    let lines = examples.iter().map(|(purpose, line)| match *purpose {
        "" => format!("  {line}"),
        purpose => format!("  # {purpose}\n  {line}"),
    });
    format!("Examples:\n{}", lines.collect::<Vec<_>>().join("\n"))
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
        for (path, examples) in EXAMPLES {
            for (_, line) in examples {
                let parsed = command().try_get_matches_from(words(line));
                assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
                assert!(line.starts_with(&format!("trocar {path}")), "{line} is none of {path}");
            }
        }
    }

    #[test]
    fn every_command_names_a_page_that_the_program_prints() {
        for (path, _) in EXAMPLES {
            let parsed = command().try_get_matches_from(["trocar", "man", page(path)]);
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
