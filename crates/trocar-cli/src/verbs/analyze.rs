//! `trocar analyze`

use std::fmt::Write as _;
use std::path::PathBuf;

use trocar::analyze::{
    Analysis, BranchPassage, CycleWork, ElementAnalysis, ReachesSliding, SpeedRange, SteadyPoint,
    SteadyState, analyze,
};
use trocar::model_file::ModelFile;
use trocar::profile::{is_passive, longest_storage};

use crate::Completion;
use crate::console::{self, Console};
use crate::table::{Table, number};

/// Check the paper's propositions for a model, and what happens where they fail
///
/// Compares with simulations: proposition III.1 (the seal reaches sliding), III.2 (steady force and
/// deflection), III.3 (stability), stick-slip and snap-through, the energy of full cycles, and the
/// error of the 1 kHz step. A full cycle that yields work makes the model doubtful (exit code 3).
/// Applies to EMS elements only.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Model file (model.json)
    model: PathBuf,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(console: &Console, args: &Args) -> anyhow::Result<Completion> {
    let model = ModelFile::read(&args.model)?;
    let stages = model.stages().map_err(|error| error.in_file(&args.model))?;
    let analysis = analyze(stages);
    if args.json {
        console::print_json(&analysis)?;
    } else {
        console::print(&text(&analysis))?;
    }
    let given_off = model.trocar.profile().is_some_and(|profile| {
        let length = longest_storage(stages);
        let passive = is_passive(profile, length);
        let (verdict, limit) = if passive { ("keeps", "at most") } else { ("may not keep", "above") };
        let steepness = number(profile.steepness() * length);
        console.remark(&format!(
            "position profile: {verdict} the model passive (relative slope of the gain times storage length: {steepness}, {limit} 1)"
        ));
        !passive
    });
    let gives_work = !analysis.cycle_work.holds;
    if gives_work {
        console.warn("the model gives work over a full cycle: it is not passive, and its forces are doubtful");
    }
    Ok(Completion::doubtful_if(gives_work || given_off))
}

fn text(analysis: &Analysis) -> String {
    let mut text = String::new();
    for (i, element) in analysis.elements.iter().enumerate() {
        if analysis.elements.len() > 1 {
            let _ = writeln!(text, "ELEMENT {}\n", i + 1);
        }
        element_text(&mut text, element);
    }
    let CycleWork { cycles, holds, verdict } = &analysis.cycle_work;
    heading(&mut text, *holds, "Energy of full cycles", verdict);
    let mut table = Table::headed(["speed mm/s", "work mJ", "sliding alone mJ"]);
    for cycle in cycles {
        table.row(
            [1e3 * cycle.speed_m_s, 1e3 * cycle.work_j, 1e3 * cycle.sliding_work_j].map(number),
        );
    }
    let _ = writeln!(text, "{}", table.to_text());
    heading(&mut text, analysis.step_error.holds, "Step", &analysis.step_error.verdict);
    text
}

fn heading(text: &mut String, holds: bool, what: &str, verdict: &str) {
    let _ = writeln!(text, "{} {what}: {verdict}", if holds { "[holds]" } else { "[FAILS]" });
}

fn element_text(text: &mut String, element: &ElementAnalysis) {
    let ReachesSliding { branches, softening_of_partial_reversals, holds } =
        &element.reaches_sliding;
    heading(text, *holds, "Proposition III.1", "at constant velocity the seal reaches sliding");
    for branch in branches {
        branch_text(text, branch);
    }
    if let Some(partial) = softening_of_partial_reversals {
        let _ = writeln!(
            text,
            "    partial reversals: the force rises outside z = {} to {} mm",
            number(1e3 * partial.from_m),
            number(1e3 * partial.to_m)
        );
    }
    text.push('\n');
    let steady = &element.steady_state;
    heading(text, steady.holds, "Proposition III.2", &steady.verdict);
    heading(text, element.stability.holds, "Proposition III.3", &element.stability.verdict);
    let _ = writeln!(text, "{}", steady_table(steady));
    for found in &element.stability.stick_slip {
        let _ = writeln!(
            text,
            "    stick-slip on {}: {} to {} N at {} mm/s, {} Hz; unstable from {}\n",
            found.direction.name(),
            number(found.lowest_force_n),
            number(found.highest_force_n),
            number(1e3 * found.speed_m_s),
            number(found.frequency_hz),
            in_words(found.unstable)
        );
    }
}

fn branch_text(text: &mut String, branch: &BranchPassage) {
    let _ = writeln!(text, "    {}: {}", branch.direction.name(), branch.verdict);
    for interval in &branch.softening {
        let _ = writeln!(
            text,
            "      d(k z)/dz <= 0 from z = {} to {} mm",
            number(1e3 * interval.from_m),
            number(1e3 * interval.to_m)
        );
    }
    if let Some(travel) = branch.longest_travel_to_sliding_m {
        let _ = writeln!(text, "      slides after at most {} mm of travel", number(1e3 * travel));
    }
    if let Some(range) = branch.bistable {
        let _ = writeln!(
            text,
            "      two equilibria from {}: which one depends on the past",
            in_words(range)
        );
    }
}

fn in_words(SpeedRange { from_m_s, to_m_s }: SpeedRange) -> String {
    format!("{} to {} mm/s", number(1e3 * from_m_s), number(1e3 * to_m_s))
}

fn steady_table(steady: &SteadyState) -> String {
    let mut table = Table::headed([
        "speed mm/s",
        "force N (16)",
        "deflection mm (17)",
        "eigenvalue 1/s (22)",
        "time constant ms",
        "simulated - (16) N",
        "stable",
    ]);
    steady.table.iter().for_each(|point| table.row(cells(point)));
    table.to_text()
}

fn cells(point: &SteadyPoint) -> [String; 7] {
    [
        number(1e3 * point.velocity_m_s),
        number(point.force_n),
        number(1e3 * point.deflection_m),
        number(point.eigenvalue_1_s),
        number(1e3 * point.time_constant_s),
        number(point.simulated_difference_n),
        if point.stable { "yes" } else { "NO" }.to_owned(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use trocar_model::{Element, ElementParams};

    #[test]
    fn work_out_of_nothing_is_said() {
        let element = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
        let mut analysis = analyze(&element.into());
        assert!(text(&analysis).contains("[holds] Energy"));
        analysis.cycle_work.holds = false;
        assert!(text(&analysis).contains("[FAILS] Energy"));
    }
}
