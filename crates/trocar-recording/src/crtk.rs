//! Meaning of the topics of a surgical robot, from the names of the collaborative robotics toolkit
//! (key CRTK in SOURCES.md) and the types of their messages.
//!
//! `measured_js`, `measured_cp`, `measured_cv`, `measured_cf` are measured joints, pose, velocity
//! and wrench. `setpoint_`, `servo_`, `interpolate_`, `move_` and `goal_` are commands, which are
//! never used as measurements. The instrument moves along its insertion joint, which is prismatic:
//! position in m, effort in N, positive on insertion.

use super::columns::Quantity;
use super::formats::{HEADER_STAMP, LOG_TIME};

/// Certainty of an interpretation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Certainty {
    /// Possible; must be confirmed by the user.
    Unclear,
    /// Measured by something else than a sensor of the quantity; used if there is no such sensor.
    Indirect,
    /// Used if there is nothing better, with a note.
    Likely,
    /// Follows from the names.
    Clear,
}

/// Possible meaning of a column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Candidate {
    pub(crate) quantity: Quantity,
    /// The SI unit implied by names and types.
    pub(crate) unit: &'static str,
    pub(crate) why: String,
    pub(crate) certainty: Certainty,
}

/// Meaning of a column according to its name in a topic.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Meaning {
    Candidate(Candidate),
    /// A command; the reason as text.
    Command(String),
    Unknown,
}

/// CRTK operations that are commands.
const COMMANDS: [&str; 5] = ["setpoint", "servo", "interpolate", "move", "goal"];

/// The joint that moves an instrument through its trocar, as the last part of a joint's name.
const INSERTION: &str = "insertion";

/// Largest travel along the other two axes, relative to that along one axis, at which the latter
/// counts as the instrument's.
const ACROSS: f64 = 0.05;

/// Meaning of column `field` of the topic `topic` with messages of the type `kind`.
pub(crate) fn meaning(topic: &str, kind: &str, field: &str) -> Meaning {
    let operation = topic.rsplit('/').next().unwrap_or(topic);
    let verb = operation.split('_').next().unwrap_or(operation);
    let is_value = field != HEADER_STAMP && field != LOG_TIME;
    if is_value && COMMANDS.contains(&verb) {
        return Meaning::Command(format!(
            "{operation} is what was commanded, not what was measured"
        ));
    }
    let measured = verb == "measured";
    let found = match kind.rsplit('/').next().unwrap_or(kind) {
        _ if !is_value => Some(time(field)),
        "JointState" => joint(field, measured),
        "WrenchStamped" | "Wrench" => force(field, measured),
        "PoseStamped" | "Pose" | "TransformStamped" => pose(field),
        "TwistStamped" | "Twist" => twist(field),
        _ => None,
    };
    found.map_or(Meaning::Unknown, Meaning::Candidate)
}

/// The axis with nearly all of the travel of a pose, from the range of each coordinate; `None` if
/// there is none.
pub(crate) fn axis_of_travel(ranges: [f64; 3]) -> Option<usize> {
    let longest = (0..3).max_by(|&a, &b| ranges[a].total_cmp(&ranges[b]))?;
    let is_alone =
        (0..3).filter(|&axis| axis != longest).all(|axis| ranges[axis] <= ACROSS * ranges[longest]);
    (ranges[longest] > 0.0 && is_alone).then_some(longest)
}

fn candidate(quantity: Quantity, unit: &'static str, certainty: Certainty, why: &str) -> Candidate {
    Candidate { quantity, unit, certainty, why: why.to_owned() }
}

fn time(field: &str) -> Candidate {
    if field == HEADER_STAMP {
        candidate(Quantity::Time, "s", Certainty::Clear, "the time that the message itself carries")
    } else {
        candidate(
            Quantity::Time,
            "s",
            Certainty::Likely,
            "the time at which the message was logged, later than measured",
        )
    }
}

/// `position[insertion]` and similar.
fn joint(field: &str, measured: bool) -> Option<Candidate> {
    let (array, label) = field.strip_suffix(']')?.split_once('[')?;
    let is_insertion = label.rsplit(['_', '/', '-']).next() == Some(INSERTION)
        || label.ends_with("insertion_joint");
    let is_unnamed = label.bytes().all(|byte| byte.is_ascii_digit());
    if !is_insertion && !is_unnamed {
        return None;
    }
    let (quantity, unit, what) = match array {
        "position" => (Quantity::Position, "m", "position of a prismatic joint"),
        "velocity" => (Quantity::Velocity, "m/s", "velocity of a prismatic joint"),
        "effort" => (
            Quantity::Force,
            "N",
            "effort of the joint's motor, not a force sensor: drive friction and inertia are in it",
        ),
        _ => return None,
    };
    if is_unnamed {
        let why = "the message does not name its joints; the third of an instrument's arm is its insertion in m, the others turn";
        return Some(candidate(quantity, unit, Certainty::Unclear, why));
    }
    let certainty = match quantity {
        Quantity::Force => Certainty::Indirect,
        _ if measured => Certainty::Clear,
        _ => Certainty::Likely,
    };
    Some(candidate(quantity, unit, certainty, &format!("{what}, by its name {label}")))
}

fn force(field: &str, measured: bool) -> Option<Candidate> {
    if field.strip_prefix("wrench.").unwrap_or(field) != "force.z" {
        return None;
    }
    let why = "force along z, the instrument's axis by convention, positive on insertion; x and y are left out";
    let certainty = if measured { Certainty::Clear } else { Certainty::Likely };
    Some(candidate(Quantity::Force, "N", certainty, why))
}

fn pose(field: &str) -> Option<Candidate> {
    let (front, axis) = field.rsplit_once('.')?;
    let is_place = ["position", "pose.position", "transform.translation"].contains(&front);
    let why = "one coordinate of a place; along the instrument only if this axis carries nearly all of the travel";
    (is_place && ["x", "y", "z"].contains(&axis))
        .then(|| candidate(Quantity::Position, "m", Certainty::Unclear, why))
}

fn twist(field: &str) -> Option<Candidate> {
    let (front, axis) = field.rsplit_once('.')?;
    let is_speed = ["linear", "twist.linear"].contains(&front);
    let why = "one component of a velocity; along the instrument only if it moves along this axis";
    (is_speed && ["x", "y", "z"].contains(&axis))
        .then(|| candidate(Quantity::Velocity, "m/s", Certainty::Unclear, why))
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOINTS: &str = "sensor_msgs/msg/JointState";

    fn found(topic: &str, kind: &str, field: &str) -> Option<(Quantity, &'static str, Certainty)> {
        match meaning(topic, kind, field) {
            Meaning::Candidate(Candidate { quantity, unit, certainty, .. }) => {
                Some((quantity, unit, certainty))
            }
            _ => None,
        }
    }

    #[test]
    fn measured_topics_are_understood() {
        use Certainty::*;
        for (topic, kind, field, expected) in [
            ("/psm1/measured_js", JOINTS, "position[insertion]", (Quantity::Position, "m", Clear)),
            (
                "/PSM1/measured_js",
                JOINTS,
                "position[outer_insertion]",
                (Quantity::Position, "m", Clear),
            ),
            (
                "/psm1/measured_js",
                JOINTS,
                "velocity[insertion]",
                (Quantity::Velocity, "m/s", Clear),
            ),
            ("/psm1/measured_js", JOINTS, "effort[insertion]", (Quantity::Force, "N", Indirect)),
            ("/psm1/measured_js", JOINTS, "position[2]", (Quantity::Position, "m", Unclear)),
            ("/joint_states", JOINTS, "position[arm_insertion]", (Quantity::Position, "m", Likely)),
            (
                "/psm1/body/measured_cf",
                "geometry_msgs/WrenchStamped",
                "wrench.force.z",
                (Quantity::Force, "N", Clear),
            ),
            (
                "/ft/wrench",
                "geometry_msgs/msg/WrenchStamped",
                "wrench.force.z",
                (Quantity::Force, "N", Likely),
            ),
            (
                "measured_cp",
                "geometry_msgs/msg/PoseStamped",
                "pose.position.x",
                (Quantity::Position, "m", Unclear),
            ),
            (
                "measured_cv",
                "geometry_msgs/msg/TwistStamped",
                "twist.linear.z",
                (Quantity::Velocity, "m/s", Unclear),
            ),
            ("/psm1/measured_js", JOINTS, HEADER_STAMP, (Quantity::Time, "s", Clear)),
            ("/psm1/measured_js", JOINTS, LOG_TIME, (Quantity::Time, "s", Likely)),
        ] {
            assert_eq!(found(topic, kind, field), Some(expected), "{topic} {field}");
        }
    }

    #[test]
    fn what_turns_and_what_acts_across_is_nothing() {
        assert_eq!(found("/psm1/measured_js", JOINTS, "position[yaw]"), None);
        assert_eq!(
            found("/psm1/measured_cf", "geometry_msgs/msg/WrenchStamped", "wrench.force.x"),
            None
        );
        assert_eq!(
            found("/psm1/measured_cf", "geometry_msgs/msg/WrenchStamped", "wrench.torque.z"),
            None
        );
        assert_eq!(
            found("/psm1/measured_cp", "geometry_msgs/msg/PoseStamped", "pose.orientation.z"),
            None
        );
    }

    #[test]
    fn commands_are_never_measurements() {
        for topic in
            ["/psm1/setpoint_js", "/psm1/servo_jp", "/psm1/move_jp", "/psm1/interpolate_jp"]
        {
            let meaning = meaning(topic, JOINTS, "position[insertion]");
            assert!(
                matches!(&meaning, Meaning::Command(why) if why.contains("commanded")),
                "{meaning:?}"
            );
        }
    }

    #[test]
    fn an_axis_is_the_instruments_only_alone() {
        assert_eq!(axis_of_travel([0.001, 0.002, 0.1]), Some(2));
        assert_eq!(axis_of_travel([0.1, 0.02, 0.001]), None);
        assert_eq!(axis_of_travel([0.0; 3]), None);
    }
}
