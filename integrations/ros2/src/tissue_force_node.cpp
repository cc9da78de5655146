#include <trocar_ros/tissue_force_node.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>

#include <rclcpp_components/register_node_macro.hpp>

#include <trocar_ros/declare.hpp>

namespace trocar_ros {

namespace {

using diagnostic_msgs::msg::DiagnosticStatus;

constexpr std::int64_t kSecond_ns = 1'000'000'000;

/** Stamps of the two topics that lie further apart come of two clocks, or of a very late topic, s. */
constexpr double kApart_s = 1.0;

unsigned char number(Level level) {
    switch (level) {
    case Level::ok:
        return DiagnosticStatus::OK;
    case Level::warn:
        return DiagnosticStatus::WARN;
    case Level::stale:
        return DiagnosticStatus::STALE;
    case Level::error:
        break;
    }
    return DiagnosticStatus::ERROR;
}

void add(DiagnosticStatus &status, const char *key, const std::string &value) {
    diagnostic_msgs::msg::KeyValue pair;
    pair.key = key;
    pair.value = value;
    status.values.push_back(pair);
}

geometry_msgs::msg::Vector3 vector(const std::array<double, 3> &from) {
    geometry_msgs::msg::Vector3 to;
    to.x = from[0];
    to.y = from[1];
    to.z = from[2];
    return to;
}

/** Takes the value of a change; rclcpp has refused those of another type before. */
template <typename Value> void take(Value &value, const rclcpp::Parameter &change) {
    value = change.get_value<Value>();
}

} // namespace

TissueForceNode::TissueForceNode(const rclcpp::NodeOptions &options) : rclcpp::Node("tissue_force", options) {
    NodeParameters parameters;
    declare(*this, parameters);
    setup_.start(parameters);
    if (setup_.tissue() == nullptr) {
        RCLCPP_ERROR(get_logger(), "no tissue force: %s", setup_.refusal().c_str());
    }

    // Nothing across the shaft is estimated: unknown, and 0 in the force itself.
    const double unknown = std::numeric_limits<double>::infinity();
    variance_message_.wrench.force = vector({unknown, unknown, unknown});
    variance_message_.wrench.torque = vector({unknown, unknown, unknown});

    const rclcpp::SensorDataQoS qos;
    force_publisher_ = create_publisher<geometry_msgs::msg::WrenchStamped>("tissue_cf", qos);
    variance_publisher_ = create_publisher<geometry_msgs::msg::WrenchStamped>("tissue_cf_variance", qos);
    diagnostics_publisher_ = create_publisher<diagnostic_msgs::msg::DiagnosticArray>("/diagnostics", rclcpp::QoS(10));
    joint_state_subscription_ = create_subscription<sensor_msgs::msg::JointState>(
        "measured_js", qos,
        [this](const sensor_msgs::msg::JointState::ConstSharedPtr message) { on_joint_state(*message); });
    wrench_subscription_ = create_subscription<geometry_msgs::msg::WrenchStamped>(
        "measured_cf", qos,
        [this](const geometry_msgs::msg::WrenchStamped::ConstSharedPtr message) { on_wrench(*message); });
    timer_ = create_wall_timer(std::chrono::seconds(1), [this] { report(); });
    validate_callback_ = add_on_set_parameters_callback([this](const std::vector<rclcpp::Parameter> &changes) {
        const auto result = validate(changes);
#if !TROCAR_ROS_HAS_POST_SET
        apply();
#endif
        return result;
    });
#if TROCAR_ROS_HAS_POST_SET
    apply_callback_ = add_post_set_parameters_callback([this](const std::vector<rclcpp::Parameter> &) { apply(); });
#endif
}

rcl_interfaces::msg::SetParametersResult TissueForceNode::validate(const std::vector<rclcpp::Parameter> &changes) {
    const std::lock_guard<std::mutex> lock(mutex_);
    NodeParameters wanted = setup_.parameters();
    bool is_ours = false;
    bool reads_model = false;
    for (const rclcpp::Parameter &change : changes) {
        reads_model = reads_model || change.get_name() == "model_path";
        wanted.each([&](const char *name, auto &value, const char *, const std::optional<Range> &) {
            if (change.get_name() == name) {
                take(value, change);
                is_ours = true;
            }
        });
    }
    rcl_interfaces::msg::SetParametersResult result;
    result.successful = true;
    if (!is_ours) {
        setup_.forget();
        return result;
    }
    result.successful = setup_.validate(wanted, reads_model, result.reason);
    if (!result.successful) {
        RCLCPP_ERROR(get_logger(), "parameters unchanged: %s", result.reason.c_str());
    }
    return result;
}

void TissueForceNode::apply() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!setup_.apply()) {
        return;
    }
    reported_ = {};
    reported_.unstamped = joint_state_.unstamped + wrench_.unstamped;
    reported_.without_joint = joint_state_.without_joint;
    reported_.refused = refused_;
}

void TissueForceNode::on_joint_state(const sensor_msgs::msg::JointState &message) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const std::optional<std::int64_t> stamp_ns = stamp(message.header.stamp, joint_state_);
    const std::optional<double> position_m = joint_position(message);
    if (setup_.tissue() == nullptr || !stamp_ns || !position_m) {
        return;
    }
    setup_.tissue()->add_position(*stamp_ns, setup_.parameters().invert_position ? -*position_m : *position_m);
    publish_samples();
}

void TissueForceNode::on_wrench(const geometry_msgs::msg::WrenchStamped &message) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const std::optional<std::int64_t> stamp_ns = stamp(message.header.stamp, wrench_);
    const std::string &given = setup_.parameters().frame_id;
    const std::string &frame = given.empty() ? message.header.frame_id : given;
    if (force_message_.header.frame_id != frame) {
        force_message_.header.frame_id = frame;
        variance_message_.header.frame_id = frame;
    }
    if (setup_.tissue() == nullptr || !stamp_ns) {
        return;
    }
    const geometry_msgs::msg::Vector3 &force = message.wrench.force;
    setup_.tissue()->add_reading(*stamp_ns, setup_.axis().of({force.x, force.y, force.z}));
    publish_samples();
}

std::optional<std::int64_t> TissueForceNode::stamp(const builtin_interfaces::msg::Time &stamp, Topic &topic) {
    topic.arrival_ns = steady_clock_.now().nanoseconds();
    if (setup_.parameters().use_arrival_time) {
        return get_clock()->now().nanoseconds();
    }
    // Not by rclcpp::Time, which throws where it is negative.
    if (stamp.sec < 0 || stamp.nanosec >= kSecond_ns || (stamp.sec == 0 && stamp.nanosec == 0)) {
        ++topic.unstamped;
        return std::nullopt;
    }
    return stamp.sec * kSecond_ns + stamp.nanosec;
}

std::optional<double> TissueForceNode::joint_position(const sensor_msgs::msg::JointState &message) {
    const bool is_there = joint_place_ < message.name.size() && message.name[joint_place_] == setup_.parameters().joint;
    if (!is_there) {
        const auto found = std::find(message.name.begin(), message.name.end(), setup_.parameters().joint);
        joint_place_ = static_cast<std::size_t>(found - message.name.begin());
    }
    if (joint_place_ >= message.name.size() || joint_place_ >= message.position.size()) {
        ++joint_state_.without_joint;
        return std::nullopt;
    }
    return message.position[joint_place_];
}

void TissueForceNode::publish_samples() {
    while (const std::optional<Sample> sample = setup_.tissue()->next()) {
        if (!sample->estimate) {
            ++refused_;
            last_refusal_ = sample->estimate.status;
        }
        publish(*sample);
    }
}

void TissueForceNode::publish(const Sample &sample) {
    force_message_.header.stamp.sec = static_cast<std::int32_t>(sample.stamp_ns / kSecond_ns);
    force_message_.header.stamp.nanosec = static_cast<std::uint32_t>(sample.stamp_ns % kSecond_ns);
    force_message_.wrench.force = vector(setup_.axis().along(sample.tissue_force_n()));
    variance_message_.header.stamp = force_message_.header.stamp;
    const double unknown = std::numeric_limits<double>::infinity();
    std::array<double, 3> variance_n2{unknown, unknown, unknown};
    variance_n2[setup_.axis().component] = sample.variance_n2;
    variance_message_.wrench.force = vector(variance_n2);
    force_publisher_->publish(force_message_);
    variance_publisher_->publish(variance_message_);
}

void TissueForceNode::report() {
    const std::lock_guard<std::mutex> lock(mutex_);
    diagnostic_msgs::msg::DiagnosticArray message;
    const std::int64_t now_ns = get_clock()->now().nanoseconds();
    message.header.stamp.sec = static_cast<std::int32_t>(now_ns / kSecond_ns);
    message.header.stamp.nanosec = static_cast<std::uint32_t>(now_ns % kSecond_ns);
    DiagnosticStatus status;
    status.name = std::string(get_fully_qualified_name()) + ": tissue force";
    status.hardware_id = setup_.parameters().model_path;
    const Health health = judge();
    status.level = number(health.level());
    status.message = health.reasons().empty() ? "tissue force is estimated" : health.reasons();
    add_values(status);
    message.status.push_back(status);
    diagnostics_publisher_->publish(message);
}

Health TissueForceNode::judge() {
    Health health;
    if (setup_.tissue() == nullptr) {
        health.raise(Level::error, setup_.refusal());
        return health;
    }
    judge_topics(health);
    judge_samples(health);
    const std::string topic = force_publisher_->get_topic_name();
    if (count_publishers(topic) > 1) {
        health.raise(Level::warn, "another node publishes " + topic + " as well");
    }
    reported_ = {setup_.tissue()->counts(), joint_state_.unstamped + wrench_.unstamped, joint_state_.without_joint,
                 refused_};
    return health;
}

void TissueForceNode::judge_topics(Health &health) const {
    const std::int64_t now_ns = steady_clock_.now().nanoseconds();
    bool both_run = true;
    for (const Topic *topic : {&joint_state_, &wrench_}) {
        if (!topic->arrival_ns) {
            health.raise(Level::stale, std::string("no message on ") + topic->name + " yet");
            both_run = false;
        } else if (static_cast<double>(now_ns - *topic->arrival_ns) / 1e9 > setup_.parameters().stale_after_s) {
            health.raise(Level::stale, std::string(topic->name) + " has stopped");
            both_run = false;
        }
    }
    if (joint_state_.without_joint > reported_.without_joint) {
        health.raise(Level::error, "no position of joint \"" + setup_.parameters().joint + "\" in measured_js");
    }
    if (joint_state_.unstamped + wrench_.unstamped > reported_.unstamped) {
        health.raise(Level::error, "messages without a valid header.stamp: stamp them, or set use_arrival_time");
    }
    const std::optional<double> apart_s = setup_.tissue()->stamps_apart_s();
    if (both_run && apart_s && std::abs(*apart_s) > kApart_s) {
        health.raise(Level::error, "stamps of measured_js are " + std::to_string(*apart_s) +
                                       " s ahead of those of measured_cf: two clocks? See use_arrival_time");
    }
}

void TissueForceNode::judge_samples(Health &health) const {
    const Counts &now = setup_.tissue()->counts();
    const Counts &before = reported_.counts;
    for (std::size_t fault = TROCAR_FAULT_NONE + 1; fault < now.faults.size(); ++fault) {
        if (const std::uint64_t count = now.faults[fault] - before.faults[fault]) {
            health.raise(Level::warn, std::to_string(count) + " samples: " +
                                          trocar::fault_message(static_cast<trocar::Fault>(fault)));
        }
    }
    const auto ignored = [](const StreamCounts &counts) { return counts.repeated + counts.late + counts.stray; };
    for (const auto &[name, counts, counts_before] :
         {std::tuple("measured_js", now.positions, before.positions), {"measured_cf", now.readings, before.readings}}) {
        if (const std::uint64_t count = ignored(counts) - ignored(counts_before)) {
            health.raise(Level::warn, std::to_string(count) + " messages of " + name +
                                          " ignored: stamp repeated, late or far off");
        }
        if (counts.set_back > counts_before.set_back) {
            health.raise(Level::warn, std::string("stamps of ") + name + " went back: restarted");
        }
    }
    if (now.left_out > before.left_out) {
        health.raise(Level::warn, std::to_string(now.left_out - before.left_out) + " positions left out");
    }
    if (refused_ > reported_.refused) {
        health.raise(Level::error, trocar::message(last_refusal_));
    }
}

void TissueForceNode::add_values(DiagnosticStatus &status) const {
    if (setup_.tissue() == nullptr) {
        return;
    }
    const Counts &counts = setup_.tissue()->counts();
    const trocar::Drift drift = setup_.tissue()->drift();
    add(status, "samples", std::to_string(counts.samples));
    add(status, "positions left out", std::to_string(counts.left_out));
    for (const auto &[name, stream] : {std::pair("measured_js", counts.positions), {"measured_cf", counts.readings}}) {
        const auto entry = [&](const char *what, std::uint64_t count) {
            add(status, (std::string(name) + " " + what).c_str(), std::to_string(count));
        };
        entry("accepted", stream.accepted);
        entry("not finite", stream.not_finite);
        entry("repeated", stream.repeated);
        entry("late", stream.late);
        entry("far off", stream.stray);
        entry("resumed", stream.resumed);
        entry("set back", stream.set_back);
    }
    add(status, "friction over that of the model", std::to_string(drift.level));
    add(status, "its standard deviation", std::to_string(drift.level_std));
    add(status, "viscosity over that of the model", std::to_string(drift.viscosity));
}

} // namespace trocar_ros

RCLCPP_COMPONENTS_REGISTER_NODE(trocar_ros::TissueForceNode)
