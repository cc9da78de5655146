//! The results folder of an identification.

use trocar_model::Element;

use super::identification::{FigureChoice, IdentificationReport, check_choice, document};
use super::{Document, ReportError, stage_document};
use super::{card, publish};
use trocar_lab::draws;
use trocar_lab::workflow::Workflow;
use trocar_runtime::model_file::FILE_NAME;
use trocar_tables::output::StagedFolder;

/// The report. `truth` are the elements of a virtual bench, shown next to the result; `choice`
/// selects the contents of figures.
///
/// # Errors
/// [`ReportError`] for a selection that the recordings do not allow.
pub fn workflow_document(
    workflow: &Workflow,
    truth: Option<&[Element]>,
    choice: FigureChoice,
) -> Result<Document, ReportError> {
    let input = IdentificationReport {
        identification: &workflow.identification,
        own: &workflow.own,
        range: workflow.range,
        held_out: workflow.held_out.as_ref(),
        truth,
        options: &workflow.options,
        moving_mass: workflow.moving_mass,
        command: workflow.command.as_deref(),
        title: "Force between instrument and trocar",
        choice,
    };
    check_choice(&input)?;
    Ok(document(&input))
}

/// Stages model.json, card.md, summary.json, table.csv, table.tex, citation.bib, posterior.parquet if there are draws, report.html and
/// figures.
///
/// # Errors
/// As for [`workflow_document`], or when something cannot be written.
pub fn write_workflow(
    workflow: &Workflow,
    staged: &StagedFolder,
    truth: Option<&[Element]>,
    choice: FigureChoice,
) -> Result<(), ReportError> {
    let document = workflow_document(workflow, truth, choice)?;
    staged.write(FILE_NAME, workflow.model_file().to_json().as_bytes())?;
    staged.write("card.md", card::markdown(&document).as_bytes())?;
    staged.write("summary.json", workflow.summary().to_json().as_bytes())?;
    let found = &workflow.identification;
    staged.write("table.csv", publish::csv(found).as_bytes())?;
    staged.write("table.tex", publish::tex(found).as_bytes())?;
    staged.write("citation.bib", publish::CITATION.as_bytes())?;
    if let Some(posterior) = &found.posterior {
        draws::write(&draws::table(posterior), &staged.path().join(draws::FILE_NAME))?;
    }
    stage_document(staged, &document)
}
