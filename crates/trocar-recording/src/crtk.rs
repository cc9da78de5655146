//! Meaning of the topics of a surgical robot, from the names of the collaborative robotics toolkit
//! (key CRTK in SOURCES.md) and the types of their messages.
//!
//! `measured_js`, `measured_cp`, `measured_cv`, `measured_cf` are measured joints, pose, velocity
//! and wrench. `setpoint_`, `servo_`, `interpolate_`, `move_` and `goal_` are commands, which are
//! never used as measurements. The instrument moves along its insertion joint, which is prismatic:
//! position in m, effort in N, positive on insertion.

use trocar_tables::content::{HEADER_STAMP, LOG_TIME};

use super::units::Quantity;

/// Certainty of an interpretation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Certainty {
    /// Possible; must be confirmed by the user.
    Unclear,
    /// Measured by something else than a sensor of the quantity; used if there is no such sensor.
    Indirect,
    /// Computed by the robot from what it measures; used if there is no sensor.
    Estimated,
    /// A number that is called so, without a unit: perhaps a sensor. Must be confirmed by the user.
    Called,
    /// Used if there is nothing better, with a note.
    Likely,
    /// Follows from the names.
    Clear,
}

/// Possible meaning of a column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Candidate {
    pub(crate) quantity: Quantity,
    /// Number of its units per SI unit, if names and types imply a unit.
    pub(crate) per_si: Option<f64>,
    pub(crate) why: String,
    pub(crate) certainty: Certainty,
}

/// Meaning of a column according to its name in a topic.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Meaning {
    Candidate(Candidate),
    /// A command, or another field of a message that is understood: no measurement of a quantity.
    Nothing,
    /// A message of another type.
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
        return Meaning::Nothing;
    }
    let measured = verb == "measured";
    let found = match kind.rsplit('/').next().unwrap_or(kind) {
        _ if !is_value => Some(time(field)),
        "JointState" => joint(field, measured),
        "WrenchStamped" | "Wrench" => force(field, measured),
        "PoseStamped" | "Pose" | "TransformStamped" => pose(field),
        "TwistStamped" | "Twist" => twist(field),
        _ => return Meaning::Unknown,
    };
    found.map_or(Meaning::Nothing, Meaning::Candidate)
}

/// Words in names of topics with forces that are computed, mostly from the currents of motors.
const ESTIMATES: [&str; 8] =
    ["ext", "external", "est", "estimate", "estimated", "observer", "observed", "hat"];

/// Why the force of a topic is an estimate, if it is: by its name, or because `measured_cf` lies in
/// the namespace of an arm, which has joints and poses. `all` are the names of the topics.
pub(crate) fn estimate<'a>(topic: &str, all: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let lower = topic.to_lowercase();
    let mut words = lower.split(|c: char| !c.is_alphanumeric());
    if let Some(word) = words.find(|word| ESTIMATES.contains(word)) {
        return Some(format!("an estimate by its name ({word}), not a force sensor"));
    }
    let (front, operation) = topic.rsplit_once('/').unwrap_or(("", topic));
    (operation == "measured_cf" && all.into_iter().any(|other| {
        let (arm, own) = other.rsplit_once('/').unwrap_or(("", other));
        let verb = own.split('_').next().unwrap_or(own);
        let has_motion = ["_js", "_jp", "_cp", "_cv"].iter().any(|kind| own.ends_with(kind))
            && (verb == "measured" || COMMANDS.contains(&verb));
        has_motion && (front == arm || (!arm.is_empty() && front.starts_with(&format!("{arm}/"))))
    })).then(|| {
        "the arm's own estimate from the currents of its motors, not a force sensor: drive friction and inertia are in it"
            .to_owned()
    })
}

/// The axis with nearly all of the travel, from the range of each coordinate of a place; `None` if
/// there is none.
pub(crate) fn axis_of_travel(ranges: &[f64]) -> Option<usize> {
    let longest = (0..ranges.len()).max_by(|&a, &b| ranges[a].total_cmp(&ranges[b]))?;
    let mut others = (0..ranges.len()).filter(|axis| *axis != longest);
    let is_alone = others.all(|axis| ranges[axis] <= ACROSS * ranges[longest]);
    (ranges[longest] > 0.0 && is_alone).then_some(longest)
}

fn candidate(quantity: Quantity, certainty: Certainty, why: &str) -> Candidate {
    Candidate { quantity, per_si: Some(1.0), certainty, why: why.to_owned() }
}

fn time(field: &str) -> Candidate {
    if field == HEADER_STAMP {
        candidate(Quantity::Time, Certainty::Clear, "the time that the message itself carries")
    } else {
        candidate(
            Quantity::Time,
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
    let (quantity, what) = match array {
        "position" => (Quantity::Position, "position of a prismatic joint"),
        "velocity" => (Quantity::Velocity, "velocity of a prismatic joint"),
        "effort" => (
            Quantity::Force,
            "effort of the joint's motor, not a force sensor: drive friction and inertia are in it",
        ),
        _ => return None,
    };
    if is_unnamed {
        let why = "the message does not name its joints; the third of an instrument's arm is its insertion in m, the others turn";
        return Some(candidate(quantity, Certainty::Unclear, why));
    }
    let certainty = match quantity {
        Quantity::Force => Certainty::Indirect,
        _ if measured => Certainty::Clear,
        _ => Certainty::Likely,
    };
    Some(candidate(quantity, certainty, &format!("{what}, by its name {label}")))
}

fn force(field: &str, measured: bool) -> Option<Candidate> {
    if field.strip_prefix("wrench.").unwrap_or(field) != "force.z" {
        return None;
    }
    let why = "force along z, the instrument's axis by convention, positive on insertion; x and y are left out";
    let certainty = if measured { Certainty::Clear } else { Certainty::Likely };
    Some(candidate(Quantity::Force, certainty, why))
}

fn pose(field: &str) -> Option<Candidate> {
    let (front, axis) = field.rsplit_once('.')?;
    let is_place = ["position", "pose.position", "transform.translation"].contains(&front);
    let why = "one coordinate of a place; along the instrument only if this axis carries nearly all of the travel";
    (is_place && ["x", "y", "z"].contains(&axis))
        .then(|| candidate(Quantity::Position, Certainty::Unclear, why))
}

fn twist(field: &str) -> Option<Candidate> {
    let (front, axis) = field.rsplit_once('.')?;
    let is_speed = ["linear", "twist.linear"].contains(&front);
    let why = "one component of a velocity; along the instrument only if it moves along this axis";
    (is_speed && ["x", "y", "z"].contains(&axis))
        .then(|| candidate(Quantity::Velocity, Certainty::Unclear, why))
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOINTS: &str = "sensor_msgs/msg/JointState";

    fn found(topic: &str, kind: &str, field: &str) -> Option<(Quantity, Certainty)> {
        match meaning(topic, kind, field) {
            Meaning::Candidate(Candidate { quantity, certainty, .. }) => {
                Some((quantity, certainty))
            }
            _ => None,
        }
    }

    #[test]
    fn measured_topics_are_understood() {
        use Certainty::*;
        for (topic, kind, field, expected) in [
            ("/psm1/measured_js", JOINTS, "position[insertion]", (Quantity::Position, Clear)),
            ("/PSM1/measured_js", JOINTS, "position[outer_insertion]", (Quantity::Position, Clear)),
            ("/psm1/measured_js", JOINTS, "velocity[insertion]", (Quantity::Velocity, Clear)),
            ("/psm1/measured_js", JOINTS, "effort[insertion]", (Quantity::Force, Indirect)),
            ("/psm1/measured_js", JOINTS, "position[2]", (Quantity::Position, Unclear)),
            ("/joint_states", JOINTS, "position[arm_insertion]", (Quantity::Position, Likely)),
            (
                "/psm1/body/measured_cf",
                "geometry_msgs/WrenchStamped",
                "wrench.force.z",
                (Quantity::Force, Clear),
            ),
            (
                "/ft/wrench",
                "geometry_msgs/msg/WrenchStamped",
                "wrench.force.z",
                (Quantity::Force, Likely),
            ),
            (
                "measured_cp",
                "geometry_msgs/msg/PoseStamped",
                "pose.position.x",
                (Quantity::Position, Unclear),
            ),
            (
                "measured_cv",
                "geometry_msgs/msg/TwistStamped",
                "twist.linear.z",
                (Quantity::Velocity, Unclear),
            ),
            ("/psm1/measured_js", JOINTS, HEADER_STAMP, (Quantity::Time, Clear)),
            ("/psm1/measured_js", JOINTS, LOG_TIME, (Quantity::Time, Likely)),
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
            assert_eq!(meaning(topic, JOINTS, "position[insertion]"), Meaning::Nothing);
        }
    }

    #[test]
    fn the_force_of_an_arm_is_an_estimate_and_that_of_a_sensor_is_not() {
        for (topic, others, is_estimate) in [
            ("/PSM1/measured_cf", &["/PSM1/measured_js"][..], true),
            ("/PSM1/body/measured_cf", &["/PSM1/setpoint_js"], true),
            ("/psm1/spatial/measured_cf", &["/psm1/measured_cp"], true),
            ("measured_cf", &["measured_js"], true),
            ("/ATI/measured_cf", &["/PSM1/measured_js", "measured_js"], false),
            ("/PSM10/measured_cf", &["/PSM1/measured_js"], false),
            ("/ati/wrench", &["/ati/status", "/PSM1/measured_js"], false),
            ("/PSM1/ft_sensor", &["/PSM1/measured_js"], false),
            ("/panda/F_ext", &[], true),
        ] {
            assert_eq!(estimate(topic, others.iter().copied()).is_some(), is_estimate, "{topic}");
        }
    }

    #[test]
    fn an_axis_is_the_instruments_only_alone() {
        assert_eq!(axis_of_travel(&[0.001, 0.002, 0.1]), Some(2));
        assert_eq!(axis_of_travel(&[0.1, 0.02, 0.001]), None);
        assert_eq!(axis_of_travel(&[0.0; 3]), None);
    }
}
