//! What a paper takes over: the parameters as CSV and as a table of LaTeX, and what to cite.

use std::fmt::Write as _;

use trocar_identify::{Identification, Parameter};
use trocar_model::Unit;

use super::figures::name_of;
use super::number::{decimals_for, fixed, significant};

/// The paper and the program, for BibTeX.
pub(crate) const CITATION: &str = concat!(
    "@misc{trocar-paper,\n  author = {Verspecht, J. and others},\n  title = {Modeling of the interaction force between the \
     instrument and the trocar in minimally invasive surgery},\n  year = {2010}\n}\n\n@software{trocar,\n  author = {{The trocar developers}},\n  \
     title = {trocar: modelling the force between a surgical instrument and the trocar it passes through},\n  version = {",
    env!("CARGO_PKG_VERSION"),
    "}\n}\n"
);

/// All parameters in SI units with all their digits.
pub(crate) fn csv(found: &Identification) -> String {
    let mut text = "parameter,symbol,value,ci95_low,ci95_high,unit,determined\n".to_owned();
    for Parameter { id, estimate } in &found.parameters {
        let ([low, high], value) = (estimate.ci95, estimate.value);
        let (symbol, unit, known) = (id.symbol(), estimate.unit, estimate.determined);
        let _ = writeln!(text, "{id},\"{symbol}\",{value},{low},{high},{unit},{known}");
    }
    text
}

/// The parameters without the coefficients of the branches, for LaTeX.
pub(crate) fn tex(found: &Identification) -> String {
    let mut text = "% \\usepackage{booktabs}\n\\begin{tabular}{llrll}\n\\toprule\n\
                    Parameter & Symbol & Value & 95\\,\\% interval & Unit \\\\\n\\midrule\n"
        .to_owned();
    for p in found.parameters.iter().filter(|p| !p.is_coefficient()) {
        let Unit { scale, shown, .. } = p.id.unit();
        let [value, interval] = value_and_interval(p, scale);
        let (words, symbol, unit) =
            (name_of(p.id), in_tex(&p.id.symbol().to_string()), in_tex(shown));
        let unit = if shown == "1" { String::new() } else { format!("$\\mathrm{{{unit}}}$") };
        let _ = writeln!(text, "{words} & ${symbol}$ & ${value}$ & {interval} & {unit} \\\\");
    }
    in_ascii(&(text + "\\bottomrule\n\\end{tabular}\n"))
}

fn value_and_interval(p: &Parameter, scale: f64) -> [String; 2] {
    let [low, high] = p.estimate.ci95.map(|end| scale * end);
    let value = scale * p.estimate.value;
    match decimals_for(low, high).filter(|_| p.estimate.determined) {
        Some(n) => [fixed(value, n), format!("$[{}, {}]$", fixed(low, n), fixed(high, n))],
        None if low == high => [significant(value, 4), "given".to_owned()],
        None => [significant(value, 3), "not determined".to_owned()],
    }
}

/// A symbol or a unit in mathematics: all that follows an underscore is its index.
fn in_tex(symbol: &str) -> String {
    let (head, index) = symbol.split_once('_').unwrap_or((symbol, ""));
    let (index, raised) = match index.find(['⁺', '⁻']) {
        Some(at) => index.split_at(at),
        None => (index, ""),
    };
    let index = if index.is_empty() { String::new() } else { format!("_{{{index}}}") };
    format!("{head}{index}{raised}")
}

fn in_ascii(text: &str) -> String {
    const IN_TEX: [(&str, &str); 11] = [
        ("β", "\\beta "),
        ("σ", "\\sigma "),
        ("κ", "\\kappa "),
        ("τ", "\\tau "),
        ("δ", "\\delta "),
        ("⁺", "^{+}"),
        ("⁻", "^{-}"),
        ("²", "^{2}"),
        ("·", "\\,"),
        ("\u{2212}", "-"),
        ("–", "--"),
    ];
    IN_TEX.iter().fold(text.to_owned(), |text, (from, to)| text.replace(from, to))
}
