//! The page: one self-contained file, readable without JavaScript, in print, on a phone and in dark
//! mode.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest as _, Sha256};

use super::document::{Cell, Document, Figure, Section, Table, Tile};
use super::live::Embedded;
use super::number::{decimals_for, fixed, significant};
use super::style;
use trocar_tables::option::{Interface, spelt};

use super::view::printable;

const UPLOT_SCRIPT: &str = include_str!("assets/uplot/uPlot.iife.min.js");
const UPLOT_STYLE: &str = include_str!("assets/uplot/uPlot.min.css");
const UPLOT_LICENCE: &str = include_str!("assets/uplot/LICENSE");
const REPORT_SCRIPT: &str = include_str!("assets/report.js");
const REPORT_STYLE: &str = include_str!("assets/report.css");

/// Contents of one figure in the page.
pub(super) struct Drawn {
    /// The static picture, inline SVG.
    pub(super) svg: String,
    /// Data of the interactive charts, already safe inside a script element.
    pub(super) json: String,
}

/// The whole page. `drawn` holds the figures in document order, `styles` the JSON of line styles.
pub(super) fn page(
    document: &Document,
    drawn: &[Drawn],
    styles: &str,
    live: Option<&Embedded>,
) -> String {
    // In its own scope, shared with the scripts of the live model or loop.
    let scripts = live.map_or(&[] as &[&str], |live| &live.scripts);
    // A seventh of the scripts is indentation; no text in them spans lines.
    let lines = [REPORT_SCRIPT].iter().chain(scripts).flat_map(|script| script.lines());
    let script: String = lines.map(|line| format!("{}\n", line.trim_start())).collect();
    let script = format!("\"use strict\";\n(() => {{\n{script}}})();\n");
    // Nothing may be loaded, and only these two scripts and the model may run, whatever the name of
    // a recording.
    let [uplot_hash, script_hash] =
        [UPLOT_SCRIPT, &script].map(|script| STANDARD.encode(Sha256::digest(script)));
    let mut drawn = drawn.iter();
    let sections = document.sections.iter().zip(1..);
    let sections = sections.map(|(part, number)| section(part, number, &mut drawn, live));
    let main = card(&document.card)
        + &tiles(document)
        + &messages(["warnings", "Warnings"], &document.warnings)
        + &messages(["notes", "Notes"], &document.notes)
        + &sections.collect::<String>();
    format!(
        include_str!("assets/page.html"),
        uplot_hash = uplot_hash,
        script_hash = script_hash,
        module = if live.is_some() { " 'wasm-unsafe-eval'" } else { "" },
        title = typeset(&document.title),
        uplot_style = UPLOT_STYLE,
        style = REPORT_STYLE.to_owned() + &role_colours(),
        subtitle = subtitle(&document.subtitle),
        contents = contents(&document.sections),
        main = main,
        origin = origin(&document.provenance),
        chart_styles = styles,
        uplot_licence = UPLOT_LICENCE,
        uplot = UPLOT_SCRIPT,
        script = script,
    )
}

/// Escapes `text` for HTML and XML, in content and in quoted attributes.
pub(super) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in printable(text).chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            other => escaped.push(other),
        }
    }
    escaped
}

fn role_colours() -> String {
    let all = style::all();
    let (light, dark) = (style::variables(all, |s| s.light), style::variables(all, |s| s.dark));
    format!(":root{{{light}}}@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}")
}

/// An element for each text.
fn elements(name: &str, texts: &[String]) -> String {
    texts.iter().map(|text| format!("<{name}>{}</{name}>\n", typeset(text))).collect()
}

/// Escapes `text` and sets the indices of symbols low: `F_c`, `θ_12`, but not `force_n`.
fn typeset(text: &str) -> String {
    let text = spelt(text, Interface::CommandLine);
    let mut out = String::with_capacity(text.len());
    let mut rest = &*text;
    while let Some(at) = rest.find('_') {
        let (before, after) = (&rest[..at], &rest[at + 1..]);
        let mut letters = before.chars().rev();
        let is_letter = letters.next().is_some_and(char::is_alphabetic);
        let stands_alone =
            is_letter && !letters.next().is_some_and(|c| c.is_alphanumeric() || c == '_');
        let end = after.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(after.len());
        out.push_str(&escape(before));
        if stands_alone && (1..=2).contains(&end) && !after[end..].starts_with('_') {
            out += &format!("<sub>{}</sub>", &after[..end]);
            rest = &after[end..];
        } else {
            out.push('_');
            rest = after;
        }
    }
    out + &escape(rest)
}

fn subtitle(text: &str) -> String {
    if text.is_empty() {
        return String::new();
    }
    format!("<p class=\"subtitle\">{}</p>\n", escape(text))
}

fn contents(sections: &[Section]) -> String {
    if sections.len() < 2 {
        return String::new();
    }
    let entries = sections.iter().zip(1..).map(|(section, number)| {
        format!("<li><a href=\"#section-{number}\">{}</a></li>\n", escape(&section.heading))
    });
    let entries: String = entries.collect();
    format!("<nav aria-label=\"Contents\"><ul>\n{entries}</ul></nav>\n")
}

fn card(rows: &[(String, String)]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let rows = rows.iter().map(|(label, value)| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", typeset(label), typeset(value))
    });
    format!("<dl class=\"card\" aria-label=\"Model card\">\n{}</dl>\n", rows.collect::<String>())
}

fn tiles(document: &Document) -> String {
    if document.tiles.is_empty() {
        return String::new();
    }
    let tiles: String = document.tiles.iter().map(tile).collect();
    format!("<dl class=\"tiles\" aria-label=\"Summary\">\n{tiles}</dl>\n")
}

fn tile(Tile { label, value, note }: &Tile) -> String {
    let note = match note.as_str() {
        "" => String::new(),
        note => format!(" <small>{}</small>", escape(note)),
    };
    format!("<div><dt>{}</dt><dd>{}{note}</dd></div>\n", typeset(label), typeset(value))
}

fn messages([class, heading]: [&str; 2], messages: &[String]) -> String {
    if messages.is_empty() {
        return String::new();
    }
    let items = elements("li", messages);
    format!(
        "<section class=\"{class}\" aria-labelledby=\"{class}\">\n<h2 id=\"{class}\">{heading}</h2>\n<ul>\n{items}</ul>\n</section>\n"
    )
}

fn section<'d>(
    section: &Section,
    number: usize,
    drawn: &mut impl Iterator<Item = &'d Drawn>,
    live: Option<&Embedded>,
) -> String {
    let heading = escape(&section.heading);
    let paragraphs = elements("p", &section.paragraphs);
    let tables: String = section.tables.iter().map(table).collect();
    let figures = section.figures.iter().zip(drawn);
    let figures: String = figures.map(|(part, drawn)| figure(part, drawn)).collect();
    let is_live = section.live.is_some() || section.live_loop.is_some();
    let live = live.filter(|_| is_live).map_or_else(String::new, live_part);
    format!(
        "<section aria-labelledby=\"section-{number}\">\n<h2 id=\"section-{number}\">{heading}</h2>\n\
         {paragraphs}{tables}{figures}{live}</section>\n"
    )
}

/// The container in which the script builds the interactive part, with its initial content.
fn live_part(Embedded { what, module, json, .. }: &Embedded) -> String {
    format!(
        "<p class=\"on-paper\">Left out on paper: on a screen {what} runs here.</p>\n\
         <div id=\"live\" class=\"live\">\n<p class=\"live-absent\">Here {what} runs where JavaScript and WebAssembly do: in a browser \
         of 2023 or later, on a screen. The rest of the report needs neither.</p>\n\
         <script type=\"application/json\">{json}</script>\n<script type=\"application/gzip\">{module}</script>\n</div>\n"
    )
}

fn figure(figure: &Figure, Drawn { svg, json }: &Drawn) -> String {
    let Figure { id, number, .. } = figure;
    let (title, caption) = (escape(&figure.title), typeset(&figure.caption));
    let width = figure.width.millimetres();
    format!(
        "<figure id=\"figure-{id}\" data-width=\"{width}\">\n<div class=\"static\">{svg}</div>\n\
         <script type=\"application/json\">{json}</script>\n\
         <figcaption><strong>Figure {number}. {title}.</strong> {caption}</figcaption>\n</figure>\n"
    )
}

fn table(table: &Table) -> String {
    let (caption, label) = (typeset(&table.caption), escape(&table.caption));
    let (open, inner, close) = if table.collapsed {
        (format!("<details><summary>{caption}</summary>\n"), String::new(), "</details>\n")
    } else {
        (String::new(), format!("<caption><span>{caption}</span></caption>\n"), "")
    };
    let switch = table.optional.as_ref().map_or_else(String::new, |(_, words)| {
        format!("<label class=\"switch\"><input type=\"checkbox\"> {}</label>\n", escape(words))
    });
    let head: String = (0..table.columns.len()).map(|column| heading(table, column)).collect();
    let rows: String = table.rows.iter().map(|cells| row(table, cells)).collect();
    format!(
        "{open}{switch}<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"{label}\">\n<table>\n\
         {inner}<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table>\n</div>\n{close}"
    )
}

fn heading(table: &Table, column: usize) -> String {
    let is_number = table.rows.iter().any(|row| row.get(column).is_some_and(is_numeric));
    format!(
        "<th scope=\"col\"{}>{}</th>",
        class(table, column, is_number),
        typeset(&table.columns[column])
    )
}

fn row(table: &Table, cells: &[Cell]) -> String {
    let cells = cells.iter().enumerate().map(|(column, cell)| {
        // On a narrow screen an interval stands below its value, in one cell.
        let beside = cells.get(column + 1).filter(|_| is_interval(table, column + 1));
        let beside = beside.map_or_else(String::new, |interval| {
            format!("<span class=\"beside\">{}</span>", content(interval))
        });
        let (class, content) = (class(table, column, is_numeric(cell)), content(cell) + &beside);
        match column {
            0 => format!("<th scope=\"row\"{class}>{content}</th>"),
            _ => format!("<td{class}>{content}</td>"),
        }
    });
    format!("<tr>{}</tr>\n", cells.collect::<String>())
}

/// Whether a column holds the intervals of the values in the one before it.
fn is_interval(table: &Table, column: usize) -> bool {
    table.rows.iter().any(|row| matches!(row.get(column), Some(Cell::Interval { .. })))
}

fn class(table: &Table, column: usize, is_number: bool) -> String {
    let is_optional = table.optional.as_ref().is_some_and(|(columns, _)| columns.contains(&column));
    let named = [
        (is_number, "number"),
        (is_optional, "optional"),
        (column > 0 && is_interval(table, column), "apart"),
    ];
    let names: Vec<&str> = named.iter().filter(|(is, _)| *is).map(|(_, name)| *name).collect();
    if names.is_empty() { String::new() } else { format!(" class=\"{}\"", names.join(" ")) }
}

const fn is_numeric(cell: &Cell) -> bool {
    matches!(cell, Cell::Number { .. } | Cell::Estimate { .. } | Cell::Interval { .. })
}

fn content(cell: &Cell) -> String {
    match cell {
        Cell::Text(text) => typeset(text),
        Cell::Code(text) => format!("<code>{}</code>", escape(text)),
        Cell::Number { value, digits } => significant(*value, *digits),
        Cell::Estimate { value, interval: [low, high] } => rounded(*value, *low, *high),
        Cell::Interval { low, high } => {
            format!("[{}, {}]", rounded(*low, *low, *high), rounded(*high, *low, *high))
        }
        Cell::Undetermined => "<span class=\"doubt\">not determined by the data</span>".to_owned(),
        Cell::Warning(text) => format!("<span class=\"doubt\">{}</span>", escape(text)),
    }
}

fn rounded(value: f64, low: f64, high: f64) -> String {
    match decimals_for(low, high) {
        Some(decimals) if value.is_finite() => fixed(value, decimals),
        _ => significant(value, 4),
    }
}

fn origin(provenance: &[(String, String)]) -> String {
    let lines = provenance.iter().map(|(label, value)| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escape(label), escape(value))
    });
    lines.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_is_in_the_cell_of_its_value_too() {
        let estimate = Cell::Estimate { value: 3.006, interval: [2.993, 3.019] };
        let interval = Cell::Interval { low: 2.993, high: 3.019 };
        let own = Table::new("", ["Parameter", "Value", "95 % interval"]);
        let html = table(&own.row(["F_c".into(), estimate, interval]));
        let value = "<td class=\"number\">3.006<span class=\"beside\">[2.993, 3.019]</span></td>";
        assert!(html.contains(value), "{html}");
        assert_eq!(
            html.matches("class=\"number apart\"").count(),
            2,
            "its column and its heading: {html}"
        );
        let css = include_str!("assets/report.css");
        let (wide, narrow) = css.split_once("@media (max-width: 43rem)").unwrap();
        assert!(
            wide.contains(".beside { display: none") && narrow.contains(".apart { display: none")
        );
    }

    #[test]
    fn options_are_written_as_on_the_command_line() {
        let written = "use --moving-mass-kg 0.1, or F<sub>c</sub> &lt; 1";
        assert_eq!(typeset("use ‹moving_mass_kg=0.1›, or F_c < 1"), written);
        assert_eq!(escape("‹flip_force=True›"), "--flip-force");
    }
}
