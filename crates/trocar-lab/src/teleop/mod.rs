//! A teleoperator whose follower works through a trocar: operator, leader, channel, follower, seal,
//! tissue and force sensor along one degree of freedom, the axis of the instrument.
//!
//! ```text
//! M_m·dv_m/dt = F_h − B_m·v_m − F_mc            leader; F_h = k_h·(x_h − x_m) + b_h·(v_h − v_m) − m_h·dv_m/dt
//! M_s·dv_s/dt = F_sc − B_s·v_s − F_t − F_e      follower; F_t of the seal, F_e on the tissue
//! ```
//!
//! Forces are those of the instrument on seal and tissue, and of the operator on the leader; all
//! quantities are in SI units. Controllers run in sampled time, as on hardware: encoders and sensor
//! are read at each sample, and the forces F_mc and F_sc of the motors are held until the next one.
//! Between samples the plant is integrated in substeps ([`Config::substeps`]): the motion of the
//! masses is exact for forces that are linear in time within a substep, which makes it of second
//! order in the substep; where the seal decides in between whether it sticks, of first order.
//!
//! - [`Config`]: the loop and the experiment.
//! - [`Loop`]: runs it, sample by sample; [`Outcome`]: once along its motion.
//! - [`hybrid`]: linear theory of the same loop.
//! - [`Study`]: the results that the command line and Python show.

pub mod advise;
mod channel;
pub mod config;
mod contact;
mod control;
mod credit;
mod estimate;
pub mod hybrid;
pub mod merit;
mod model;
mod options;
mod outcome;
mod passivity;
mod plant;
mod simulation;
pub mod stability;
mod study;
mod table;

pub use config::{Config, ConfigError};
pub use model::{Candidates, candidates, scaled};
pub use options::{OptionError, Options};
pub use outcome::Outcome;
pub use simulation::{Diverged, Loop, Sample};
pub use study::{Questions, StepError, Study, StudyError, Summary};
pub use table::{course_columns, response_columns, write_course, write_response};
