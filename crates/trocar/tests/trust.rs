//! What the identification states with confidence is true: a few of the hard benches, with a generous bound. All of them:
//! `./test --long`.

#[path = "trust/mod.rs"]
mod trust;

use trocar::identify::Estimate;
use trust::judge::{Outcome, Verdict, judge};
use trust::kinds::kinds;

fn outcomes(names: &[&str], seeds: u64) -> Vec<Outcome> {
    let chosen = kinds().into_iter().filter(|kind| names.contains(&kind.name));
    let of_kind = |kind: trust::kinds::Kind| {
        (1..=seeds).map(move |seed| {
            let bench = (kind.make)(seed).expect("a seal and a rig");
            judge(kind.name, &bench, seed).expect("the rig runs")
        })
    };
    chosen.flat_map(of_kind).collect()
}

/// Part of the listed parameters that is confidently wrong.
fn confidently_wrong(outcomes: &[Outcome]) -> f64 {
    let count = |verdict| outcomes.iter().map(|o| o.count(verdict)).sum::<usize>();
    let listed: usize = Verdict::ALL.into_iter().filter(|v| *v != Verdict::Absent).map(count).sum();
    assert!(listed > 0);
    for o in outcomes {
        let wrong = o.judged.iter().filter(|j| j.verdict == Verdict::ConfidentlyWrong);
        wrong.for_each(|j| println!("{} {}: {j:?}", o.kind, o.seed));
    }
    count(Verdict::ConfidentlyWrong) as f64 / listed as f64
}

#[test]
fn verdicts_follow_from_interval_and_truth() {
    let found = Estimate::from_bounds(3.0, 2.9, 3.1, "N");
    assert_eq!(Verdict::of(&found, [3.1, 3.1], false), Verdict::Right);
    assert_eq!(Verdict::of(&found, [3.2, 3.2], false), Verdict::ConfidentlyWrong);
    assert_eq!(Verdict::of(&found, [3.2, 3.2], true), Verdict::WrongButDoubtful);
    // A truth that changes on the way: any of its values will do.
    assert_eq!(Verdict::of(&found, [2.0, 2.95], false), Verdict::Right);
    let open = Estimate::not_pinned(3.0, "N", "one speed");
    assert_eq!(Verdict::of(&open, [9.0, 9.0], false), Verdict::Undetermined);
}

#[test]
fn kinds_have_names_of_their_own_and_make_models() {
    let kinds = kinds();
    let mut names: Vec<&str> = kinds.iter().map(|kind| kind.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), kinds.len());
    for kind in &kinds {
        let truths = (kind.make)(1).expect("a seal and a rig").truths();
        assert!(truths.values().all(|[low, high]| low <= high && low.is_finite() && high.is_finite()), "{}", kind.name);
    }
}

#[test]
fn easy_benches_are_right() {
    let outcomes = outcomes(&["plain", "mass_0.04_declared", "one_speed", "two_speeds"], 1);
    let share = confidently_wrong(&outcomes);
    // One parameter in twenty is outside of its 95 % interval; of some thirty, two or three at times.
    assert!(share < 0.15, "{share}");
}
