//! The results folder of an identification.

use trocar_model::Element;

use super::identification::{FigureChoice, IdentificationReport, check_choice, document};
use super::{Document, ReportError, stage_document};
use crate::identify::posterior;
use crate::model_file::FILE_NAME;
use crate::output::StagedFolder;
use crate::workflow::Workflow;

impl Workflow {
    /// The report. `truth` are the elements of a virtual bench, shown next to the result; `choice`
    /// selects the contents of figures.
    ///
    /// # Errors
    /// [`ReportError`] for a selection that the recordings do not allow.
    pub fn document(
        &self,
        truth: Option<&[Element]>,
        choice: FigureChoice,
    ) -> Result<Document, ReportError> {
        let input = IdentificationReport {
            identification: &self.identification,
            training: &self.recordings,
            validation: self.validation.as_ref().map(|scores| (self.held_out.as_slice(), scores)),
            truth,
            options: &self.options,
            moving_mass: self.moving_mass,
            command: self.command.as_deref(),
            title: "Force between instrument and trocar",
            choice,
        };
        check_choice(&input)?;
        Ok(document(&input))
    }

    /// Stages model.json, summary.json, posterior.parquet if there are draws, report.html and
    /// figures.
    ///
    /// # Errors
    /// As for [`Workflow::document`], or when something cannot be written.
    pub fn write(
        &self,
        staged: &StagedFolder,
        truth: Option<&[Element]>,
        choice: FigureChoice,
    ) -> Result<(), ReportError> {
        let document = self.document(truth, choice)?;
        staged.write(FILE_NAME, self.model_file().to_json().as_bytes())?;
        staged.write("summary.json", self.summary().to_json().as_bytes())?;
        if let Some(draws) = &self.identification.posterior {
            draws.write(&staged.path().join(posterior::FILE_NAME))?;
        }
        stage_document(staged, &document)
    }
}
