//! The page: one self-contained file, readable without JavaScript, in print, on a phone and in dark
//! mode.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest as _, Sha256};

use super::document::{Cell, Document, Figure, Section, Table};
use super::live::Embedded;
use super::number::{decimals_for, fixed, significant};
use super::style;
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

/// The script of the page in its own scope, shared with the scripts of the live model or loop.
fn script(live: Option<&Embedded>) -> String {
    let live = live.map_or_else(String::new, |live| live.scripts.concat());
    format!("\"use strict\";\n(() => {{\n{REPORT_SCRIPT}{live}}})();\n")
}

/// The whole page. `drawn` holds the figures in document order, `styles` the JSON of line styles.
pub(super) fn page(
    document: &Document,
    drawn: &[Drawn],
    styles: &str,
    live: Option<&Embedded>,
) -> String {
    let script = script(live);
    let size: usize = drawn.iter().map(|figure| figure.svg.len() + figure.json.len()).sum();
    let mut page = String::with_capacity(size + 100_000);
    head(&mut page, document, &script, live.is_some());
    page.push_str("<body>\n<a class=\"skip\" href=\"#main\">Skip to the report</a>\n<header>\n");
    element(&mut page, "h1", &document.title);
    if !document.subtitle.is_empty() {
        let _ = writeln!(page, "<p class=\"subtitle\">{}</p>", escape(&document.subtitle));
    }
    page.push_str("</header>\n");
    contents(&mut page, &document.sections);
    page.push_str("<main id=\"main\">\n");
    tiles(&mut page, document);
    messages(&mut page, ["warnings", "Warnings"], &document.warnings);
    messages(&mut page, ["notes", "Notes"], &document.notes);
    let mut drawn = drawn.iter();
    for (index, part) in document.sections.iter().enumerate() {
        section(&mut page, index, part, &mut drawn, live);
    }
    page.push_str("</main>\n");
    footer(&mut page, &document.provenance);
    let _ = write!(
        page,
        "<script type=\"application/json\" id=\"chart-styles\">{styles}</script>\n<!-- uPlot 1.6.32\n"
    );
    let _ = write!(
        page,
        "{UPLOT_LICENCE}-->\n<script>{UPLOT_SCRIPT}</script>\n<script>{script}</script>\n"
    );
    page.push_str("</body>\n</html>\n");
    page
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

// Writing to a String cannot fail, so the results of `write!` are dropped throughout this file.

fn head(page: &mut String, document: &Document, script: &str, has_live: bool) {
    let hash = |script: &str| STANDARD.encode(Sha256::digest(script));
    let [uplot, report] = [UPLOT_SCRIPT, script].map(hash);
    let module = if has_live { " 'wasm-unsafe-eval'" } else { "" };
    page.push_str("<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
    page.push_str("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n");
    page.push_str("<meta name=\"color-scheme\" content=\"light dark\">\n");
    // Nothing may be loaded, and only these two scripts and the model may run, whatever the name of
    // a recording.
    let _ = writeln!(
        page,
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; \
         script-src 'sha256-{uplot}' 'sha256-{report}'{module}; img-src data: blob:; base-uri 'none'; form-action 'none'\">"
    );
    element(page, "title", &document.title);
    let _ = write!(
        page,
        "<style>{UPLOT_STYLE}</style>\n<style>{REPORT_STYLE}{}</style>\n</head>\n",
        role_colours()
    );
}

fn role_colours() -> String {
    let variables = |colour: fn(&style::Style) -> &'static str| {
        style::all().iter().fold(String::new(), |mut css, style| {
            let _ = write!(css, "--{}:{};", style.class, colour(style));
            css
        })
    };
    let (light, dark) = (variables(|style| style.light), variables(|style| style.dark));
    format!(":root{{{light}}}@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}")
}

fn element(page: &mut String, name: &str, text: &str) {
    let _ = writeln!(page, "<{name}>{}</{name}>", typeset(text));
}

/// Escapes `text` and sets the indices of symbols low: `F_c`, `θ_12`, but not `force_n`.
fn typeset(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('_') {
        let (before, after) = (&rest[..at], &rest[at + 1..]);
        let mut letters = before.chars().rev();
        let is_letter = letters.next().is_some_and(char::is_alphabetic);
        let stands_alone =
            is_letter && !letters.next().is_some_and(|c| c.is_alphanumeric() || c == '_');
        let end = after.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(after.len());
        out.push_str(&escape(before));
        if stands_alone && (1..=2).contains(&end) && !after[end..].starts_with('_') {
            let _ = write!(out, "<sub>{}</sub>", &after[..end]);
            rest = &after[end..];
        } else {
            out.push('_');
            rest = after;
        }
    }
    out + &escape(rest)
}

fn contents(page: &mut String, sections: &[Section]) {
    if sections.len() < 2 {
        return;
    }
    page.push_str("<nav aria-label=\"Contents\"><ul>\n");
    for (index, section) in sections.iter().enumerate() {
        let _ = writeln!(
            page,
            "<li><a href=\"#section-{}\">{}</a></li>",
            index + 1,
            escape(&section.heading)
        );
    }
    page.push_str("</ul></nav>\n");
}

fn tiles(page: &mut String, document: &Document) {
    if document.tiles.is_empty() {
        return;
    }
    page.push_str("<dl class=\"tiles\" aria-label=\"Summary\">\n");
    for tile in &document.tiles {
        let _ = write!(page, "<div><dt>{}</dt><dd>{}", typeset(&tile.label), typeset(&tile.value));
        if !tile.note.is_empty() {
            let _ = write!(page, " <small>{}</small>", escape(&tile.note));
        }
        page.push_str("</dd></div>\n");
    }
    page.push_str("</dl>\n");
}

fn messages(page: &mut String, [class, heading]: [&str; 2], messages: &[String]) {
    if messages.is_empty() {
        return;
    }
    let _ = writeln!(page, "<section class=\"{class}\" aria-labelledby=\"{class}\">");
    let _ = write!(page, "<h2 id=\"{class}\">{heading}</h2>\n<ul>\n");
    for message in messages {
        element(page, "li", message);
    }
    page.push_str("</ul>\n</section>\n");
}

fn section<'d>(
    page: &mut String,
    index: usize,
    section: &Section,
    drawn: &mut impl Iterator<Item = &'d Drawn>,
    live: Option<&Embedded>,
) {
    let id = format!("section-{}", index + 1);
    let heading = escape(&section.heading);
    let _ = write!(page, "<section aria-labelledby=\"{id}\">\n<h2 id=\"{id}\">{heading}</h2>\n");
    for paragraph in &section.paragraphs {
        element(page, "p", paragraph);
    }
    for part in &section.tables {
        table(page, part);
    }
    for (part, drawn) in section.figures.iter().zip(drawn) {
        figure(page, part, drawn);
    }
    let is_live = section.live.is_some() || section.live_loop.is_some();
    if let (true, Some(live)) = (is_live, live) {
        live_part(page, live);
    }
    page.push_str("</section>\n");
}

/// The container in which the script builds the interactive part, with its initial content.
fn live_part(page: &mut String, Embedded { what, module, json, .. }: &Embedded) {
    let _ = writeln!(
        page,
        "<p class=\"on-paper\">Left out on paper: on a screen {what} runs here.</p>"
    );
    let _ = write!(
        page,
        "<div id=\"live\" class=\"live\">\n<p class=\"live-absent\">Here {what} runs where JavaScript and WebAssembly do: in a browser \
         of 2023 or later, on a screen. The rest of the report needs neither.</p>\n"
    );
    let _ = writeln!(page, "<script type=\"application/json\">{json}</script>");
    let _ = writeln!(page, "<script type=\"application/gzip\">{module}</script>\n</div>");
}

fn figure(page: &mut String, figure: &Figure, drawn: &Drawn) {
    let (id, number, title) = (&figure.id, figure.number, escape(&figure.title));
    let millimetres = figure.width.millimetres();
    let _ = write!(
        page,
        "<figure id=\"figure-{id}\" data-width=\"{millimetres}\">\n<div class=\"static\">{}</div>\n",
        drawn.svg
    );
    let _ = write!(page, "<script type=\"application/json\">{}</script>\n<figcaption>", drawn.json);
    let _ = write!(
        page,
        "<strong>Figure {number}. {title}.</strong> {}</figcaption>\n</figure>\n",
        typeset(&figure.caption)
    );
}

fn table(page: &mut String, table: &Table) {
    let caption = typeset(&table.caption);
    if table.collapsed {
        let _ = writeln!(page, "<details><summary>{caption}</summary>");
    }
    if let Some((_, words)) = &table.optional {
        let _ = writeln!(
            page,
            "<label class=\"switch\"><input type=\"checkbox\"> {}</label>",
            escape(words)
        );
    }
    let label = escape(&table.caption);
    let _ = write!(
        page,
        "<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"{label}\">\n<table>\n"
    );
    if !table.collapsed {
        let _ = writeln!(page, "<caption>{caption}</caption>");
    }
    page.push_str("<thead><tr>");
    for (column, heading) in table.columns.iter().enumerate() {
        let is_number = table.rows.iter().any(|row| row.get(column).is_some_and(is_numeric));
        let class = class(is_number, is_optional(table, column));
        let _ = write!(page, "<th scope=\"col\"{class}>{}</th>", typeset(heading));
    }
    page.push_str("</tr></thead>\n<tbody>\n");
    for row in &table.rows {
        page.push_str("<tr>");
        for (column, content) in row.iter().enumerate() {
            cell(page, content, column == 0, is_optional(table, column));
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</tbody>\n</table>\n</div>\n");
    if table.collapsed {
        page.push_str("</details>\n");
    }
}

fn is_optional(table: &Table, column: usize) -> bool {
    table.optional.as_ref().is_some_and(|(columns, _)| columns.contains(&column))
}

fn class(is_number: bool, is_optional: bool) -> &'static str {
    match (is_number, is_optional) {
        (true, true) => " class=\"number optional\"",
        (true, false) => " class=\"number\"",
        (false, true) => " class=\"optional\"",
        (false, false) => "",
    }
}

const fn is_numeric(cell: &Cell) -> bool {
    matches!(cell, Cell::Number { .. } | Cell::Estimate { .. } | Cell::Interval { .. })
}

fn cell(page: &mut String, cell: &Cell, is_first: bool, is_optional: bool) {
    let (open, close) = if is_first { ("<th scope=\"row\"", "</th>") } else { ("<td", "</td>") };
    let class = class(is_numeric(cell), is_optional);
    let content = match cell {
        Cell::Text(text) => typeset(text),
        Cell::Code(text) => format!("<code>{}</code>", escape(text)),
        Cell::Number { value, digits } => significant(*value, *digits),
        Cell::Estimate { value, interval: [low, high] } => rounded(*value, *low, *high),
        Cell::Interval { low, high } => {
            format!("[{}, {}]", rounded(*low, *low, *high), rounded(*high, *low, *high))
        }
        Cell::Undetermined => "<span class=\"doubt\">not determined by the data</span>".to_owned(),
        Cell::Warning(text) => format!("<span class=\"doubt\">{}</span>", escape(text)),
    };
    let _ = write!(page, "{open}{class}>{content}{close}");
}

fn rounded(value: f64, low: f64, high: f64) -> String {
    match decimals_for(low, high) {
        Some(decimals) if value.is_finite() => fixed(value, decimals),
        _ => significant(value, 4),
    }
}

fn footer(page: &mut String, provenance: &[(String, String)]) {
    page.push_str("<footer>\n<h2>Origin</h2>\n<dl>\n");
    for (label, value) in provenance {
        let _ = writeln!(page, "<div><dt>{}</dt><dd>{}</dd></div>", escape(label), escape(value));
    }
    page.push_str("</dl>\n</footer>\n");
}
