// The node, driven through its topics. Compiled with stubs of ROS 2 (stubs/README.md). Usage: node_test MODEL.json FOLDER
#include <cmath>
#include <fstream>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <trocar_ros/tissue_force_node.hpp>

#include "check.hpp"
#include "motion.hpp"

using diagnostic_msgs::msg::DiagnosticArray;
using diagnostic_msgs::msg::DiagnosticStatus;
using geometry_msgs::msg::WrenchStamped;
using sensor_msgs::msg::JointState;
using trocar_ros::TissueForceNode;

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;
const double kNan = std::numeric_limits<double>::quiet_NaN();

std::string model_path;
std::string folder;

using Overrides = std::vector<rclcpp::Parameter>;

rclcpp::stub::World &world() { return rclcpp::stub::world(); }

builtin_interfaces::msg::Time stamp(std::int64_t ns) {
    builtin_interfaces::msg::Time time;
    time.sec = static_cast<std::int32_t>(ns / (1000 * kMs));
    time.nanosec = static_cast<std::uint32_t>(ns % (1000 * kMs));
    return time;
}

/** A node, what it publishes, and the messages that it gets. */
class Bench {
  public:
    explicit Bench(Overrides overrides = {}) {
        world().log.clear();
        overrides.emplace_back("force_error_n", 0.1);
        bool has_model = false;
        for (const rclcpp::Parameter &given : overrides) {
            has_model = has_model || given.get_name() == "model_path";
        }
        if (!has_model) {
            overrides.emplace_back("model_path", model_path);
        }
        node = std::make_unique<TissueForceNode>(rclcpp::NodeOptions().parameter_overrides(overrides));
        world().listen<WrenchStamped>(this, "/tissue_cf", [this](const WrenchStamped &m) { forces.push_back(m); });
        world().listen<WrenchStamped>(this, "/tissue_cf_variance",
                                      [this](const WrenchStamped &m) { variances.push_back(m); });
        world().listen<DiagnosticArray>(this, "/diagnostics", [this](const DiagnosticArray &m) { last = m.status.at(0); });
    }
    ~Bench() { world().forget(this); }
    Bench(const Bench &) = delete;

    JointState joints(std::int64_t stamp_ns, double position_m) const {
        JointState message;
        message.header.stamp = stamp(stamp_ns);
        message.name = {"yaw", "pitch", "insertion"};
        message.position = {0.1, 0.2, position_m};
        return message;
    }

    WrenchStamped wrench(std::int64_t stamp_ns, double force_n) const {
        WrenchStamped message;
        message.header.stamp = stamp(stamp_ns);
        message.header.frame_id = "sensor";
        message.wrench.force.x = 7.0;
        message.wrench.force.z = force_n;
        return message;
    }

    void send(const JointState &message) { world().send("/measured_js", message); }
    void send(const WrenchStamped &message) { world().send("/measured_cf", message); }

    /** Both topics at 1 kHz, from tick to before end. */
    void run(int tick, int end, double sign = 1.0) {
        for (; tick < end; ++tick) {
            world().steady_ns += kMs;
            world().ros_ns += kMs;
            const double time_s = tick * 1e-3;
            send(joints(kStart_ns + tick * kMs, sign * motion::position_m(time_s)));
            send(wrench(kStart_ns + tick * kMs, sign * motion::reading_n(time_s, static_cast<unsigned long>(tick))));
        }
    }

    /** The status after a second in which nothing else happened. */
    const DiagnosticStatus &diagnose() {
        world().tick();
        return last;
    }

    std::string value(const std::string &key) const {
        for (const auto &pair : last.values) {
            if (pair.key == key) {
                return pair.value;
            }
        }
        return "no " + key;
    }

    std::unique_ptr<TissueForceNode> node;
    std::vector<WrenchStamped> forces;
    std::vector<WrenchStamped> variances;
    DiagnosticStatus last;
};

bool holds(const std::string &text, const std::string &part) { return text.find(part) != std::string::npos; }

bool judged(const DiagnosticStatus &status, unsigned char level, const std::string &part) {
    const bool is_so = status.level == level && holds(status.message, part);
    if (!is_so) {
        std::fprintf(stderr, "level %d, expected %d: \"%s\", expected \"%s\"\n", status.level, level,
                     status.message.c_str(), part.c_str());
    }
    return is_so;
}

void publishes_the_estimate() {
    Bench bench;
    bench.run(0, 3000);
    CHECK(bench.forces.size() == 3000 && bench.variances.size() == 3000);
    trocar::CompensatorOptions options;
    options.force_error_n = 0.1;
    trocar::Compensator observer(trocar::Model::load(model_path), options);
    double before_s = 0.0;
    for (std::size_t k = 0; k < bench.forces.size(); ++k) {
        const double time_s = static_cast<double>(k) * 1e-3;
        const double exact_s = static_cast<double>(static_cast<std::int64_t>(k) * kMs) / 1e9;
        const trocar::Estimate own =
            observer.step(motion::position_m(time_s), motion::reading_n(time_s, k), exact_s - before_s);
        before_s = exact_s;
        const WrenchStamped &force = bench.forces[k];
        CHECK(force.wrench.force.z == own.tissue_force_n && force.wrench.force.x == 0.0);
        CHECK(force.header.frame_id == "sensor" && force.header.stamp.nanosec == k % 1000 * kMs);
        const WrenchStamped &variance = bench.variances[k];
        CHECK(variance.wrench.force.z == own.tissue_force_std_n * own.tissue_force_std_n);
        CHECK(std::isinf(variance.wrench.force.x) && std::isinf(variance.wrench.torque.z));
        CHECK(variance.header.stamp.sec == force.header.stamp.sec && variance.header.frame_id == "sensor");
    }
    CHECK(judged(bench.diagnose(), DiagnosticStatus::OK, "tissue force is estimated"));
    CHECK(bench.value("samples") == "3000" && bench.last.hardware_id == model_path);
}

/** A sensor and a joint mounted the other way round, with the parameters for it, give the mirrored force. */
void mirrored() {
    std::vector<WrenchStamped> expected;
    {
        Bench plain;
        plain.run(0, 500);
        expected = plain.forces;
    }
    Bench bench({{"force_axis", "-z"}, {"invert_position", true}, {"frame_id", "tool"}});
    bench.run(0, 500, -1.0);
    CHECK(bench.forces.size() == 500 && bench.forces[0].header.frame_id == "tool");
    for (std::size_t k = 0; k < bench.forces.size(); ++k) {
        CHECK(bench.forces[k].wrench.force.z == -expected[k].wrench.force.z);
    }
}

void order_of_joints() {
    Bench bench;
    bench.run(0, 100);
    JointState message;
    message.header.stamp = stamp(kStart_ns + 100 * kMs);
    message.name = {"insertion", "roll", "yaw", "pitch"};
    message.position = {motion::position_m(0.1), 3.0, 0.1, 0.2};
    bench.send(message);
    bench.send(bench.wrench(kStart_ns + 100 * kMs, 1.0));
    bench.run(101, 200);
    CHECK(bench.forces.size() == 200);
    CHECK(judged(bench.diagnose(), DiagnosticStatus::OK, "")); // no jump of the position
}

void joint_missing() {
    Bench bench;
    bench.run(0, 100);
    JointState message = bench.joints(kStart_ns + 100 * kMs, 0.1);
    message.name = {"yaw", "pitch", "roll"};
    bench.send(message);
    message.name = {"yaw", "pitch", "insertion"};
    message.position = {0.1};
    bench.send(message);
    bench.send(JointState());
    CHECK(judged(bench.diagnose(), DiagnosticStatus::ERROR, "no position of joint \"insertion\""));
    bench.run(101, 200);
    CHECK(bench.forces.size() == 199 && judged(bench.diagnose(), DiagnosticStatus::OK, ""));
}

void topics_stop() {
    Bench bench;
    CHECK(judged(bench.diagnose(), DiagnosticStatus::STALE, "no message on measured_js yet"));
    bench.run(0, 1000);
    CHECK(judged(bench.diagnose(), DiagnosticStatus::OK, ""));
    // The wrench alone: the force is published as unknown.
    for (int tick = 1000; tick < 2000; ++tick) {
        world().steady_ns += kMs;
        bench.send(bench.joints(kStart_ns + tick * kMs, motion::position_m(tick * 1e-3)));
    }
    CHECK(judged(bench.diagnose(), DiagnosticStatus::STALE, "measured_cf has stopped"));
    CHECK(holds(bench.last.message, "no force reading"));
    CHECK(std::isnan(bench.forces.back().wrench.force.z) && std::isinf(bench.variances.back().wrench.force.z));
    // Both: nothing is published.
    const std::size_t count = bench.forces.size();
    world().steady_ns += 3000 * kMs;
    CHECK(judged(bench.diagnose(), DiagnosticStatus::STALE, "measured_js has stopped"));
    CHECK(bench.forces.size() == count);
    bench.run(5000, 5400);
    CHECK(std::isfinite(bench.forces.back().wrench.force.z));
    CHECK(judged(bench.diagnose(), DiagnosticStatus::WARN, "more than 0.2 s without a sample"));
    bench.run(5400, 5800);
    CHECK(judged(bench.diagnose(), DiagnosticStatus::OK, ""));
}

void bad_stamps() {
    Bench bench;
    bench.run(0, 100);
    JointState message = bench.joints(0, 0.1);
    bench.send(message);
    message.header.stamp.sec = -5;
    bench.send(message);
    WrenchStamped wrench = bench.wrench(kStart_ns + 99 * kMs, 1.0);
    wrench.header.stamp.nanosec = 4'000'000'000U;
    bench.send(wrench);
    CHECK(judged(bench.diagnose(), DiagnosticStatus::ERROR, "without a valid header.stamp"));
    bench.send(bench.joints(kStart_ns + 99 * kMs, 0.1));
    bench.send(bench.wrench(kStart_ns + 5 * kMs, 1.0));
    CHECK(judged(bench.diagnose(), DiagnosticStatus::WARN, "1 messages of measured_js ignored"));
    CHECK(holds(bench.last.message, "1 messages of measured_cf ignored"));
    CHECK(bench.forces.size() == 100);
}

void two_clocks() {
    const auto run = [](Bench &bench) {
        for (int tick = 0; tick < 400; ++tick) {
            world().steady_ns += kMs;
            world().ros_ns += kMs;
            bench.send(bench.joints(kStart_ns + tick * kMs, motion::position_m(tick * 1e-3)));
            const double reading_n = motion::reading_n(tick * 1e-3, static_cast<unsigned long>(tick));
            bench.send(bench.wrench(50'000 * kMs + tick * kMs, reading_n));
        }
    };
    Bench bench;
    run(bench);
    CHECK(judged(bench.diagnose(), DiagnosticStatus::ERROR, "two clocks?"));
    CHECK(bench.forces.empty());
    // They count from when they arrive: those of one millisecond at the same time.
    CHECK(bench.node->set_parameter({"use_arrival_time", true}).successful);
    run(bench);
    CHECK(bench.forces.size() == 400 && judged(bench.diagnose(), DiagnosticStatus::OK, ""));
}

void not_a_number() {
    Bench bench;
    bench.run(0, 100);
    bench.send(bench.joints(kStart_ns + 100 * kMs, kNan));
    bench.send(bench.wrench(kStart_ns + 100 * kMs, kNan));
    CHECK(std::isnan(bench.forces.back().wrench.force.z) && std::isinf(bench.variances.back().wrench.force.z));
    CHECK(judged(bench.diagnose(), DiagnosticStatus::WARN, "no position"));
    bench.run(101, 200);
    CHECK(std::isfinite(bench.forces.back().wrench.force.z) && judged(bench.diagnose(), DiagnosticStatus::OK, ""));
}

/** A model file that is missing, of another version, or no model: reported in log and diagnostics; the node waits for a good one. */
void bad_models() {
    const std::string newer = folder + "/newer.json";
    std::ofstream(newer) << R"({"format": "trocar-model", "version": 99})";
    const std::string garbage = folder + "/garbage.json";
    std::ofstream(garbage) << "no model";
    for (const auto &[path, reason] : {std::pair<std::string, std::string>{"", "model_path is empty"},
                                       {folder + "/missing.json", "missing.json"},
                                       {newer, "model version 99"},
                                       {garbage, "garbage.json"}}) {
        Bench bench({{"model_path", path}});
        CHECK(!world().log.empty() && holds(world().log.back(), reason));
        bench.run(0, 100);
        CHECK(bench.forces.empty() && judged(bench.diagnose(), DiagnosticStatus::ERROR, reason));
        CHECK(bench.node->set_parameter({"model_path", model_path}).successful);
        bench.run(100, 200);
        CHECK(bench.forces.size() == 100 && judged(bench.diagnose(), DiagnosticStatus::OK, ""));
    }
}

/** What is refused changes nothing, whatever became of the file on disk. */
void parameters_refused() {
    const std::string replaced = folder + "/replaced.json";
    std::ofstream(replaced) << std::ifstream(model_path).rdbuf();
    Bench bench({{"model_path", replaced}});
    bench.run(0, 100);
    std::ofstream(replaced) << "no model";
    const std::vector<std::pair<rclcpp::Parameter, std::string>> bad{
        {{"model_path", replaced}, "replaced.json"},
        {{"force_axis", "q"}, "force_axis must be x, y, z, -x, -y or -z, got \"q\""},
        {{"force_error_n", -1.0}, "force_error"},
        {{"force_error_n", kNan}, "force_error"},
        {{"moving_mass_kg", std::numeric_limits<double>::infinity()}, "moving_mass"},
        {{"sensor_limit_n", 0.0}, "sensor_limit"},
        {{"gravity_m_s2", kNan}, ""},
        {{"longest_interval_s", 2.0}, ""},
        {{"stale_after_s", 0.0}, ""},
        {{"adaptation", 1.0}, ""},
        {{"joint", 3.0}, ""},
    };
    for (const auto &[parameter, reason] : bad) {
        const auto result = bench.node->set_parameter(parameter);
        const bool is_so = !result.successful && !result.reason.empty() && holds(result.reason, reason);
        CHECK(is_so || (std::fprintf(stderr, "%s: \"%s\"\n", parameter.get_name().c_str(), result.reason.c_str()), false));
    }
    bench.run(100, 200);
    CHECK(bench.forces.size() == 200 && bench.forces.back().header.stamp.nanosec == 199 * kMs);
    CHECK(judged(bench.diagnose(), DiagnosticStatus::OK, "") && bench.value("samples") == "200");
    // Nor does the file matter where another parameter is set.
    CHECK(bench.node->set_parameter({"adaptation", false}).successful);
    bench.run(200, 300);
    CHECK(bench.forces.size() == 300);
    for (const auto &[name, descriptor] : bench.node->descriptors()) {
        CHECK(descriptor.description.size() > 20);
    }
    CHECK(bench.node->descriptors().size() == 15);
}

/** What the node accepts and another callback refuses changes nothing. */
void parameters_refused_by_others() {
    Bench bench;
    bench.run(0, 100);
    world().refused_parameter = "frame_id";
    const bool is_set = bench.node->set_parameter({"frame_id", "tool"}).successful;
    world().refused_parameter.clear();
    CHECK(!is_set);
    bench.run(100, 200);
#if TROCAR_ROS_HAS_POST_SET
    CHECK(bench.forces.back().header.frame_id == "sensor" && bench.forces.size() == 200);
    bench.diagnose();
    CHECK(bench.value("samples") == "200"); // the observer is the same
#endif
    CHECK(bench.node->set_parameter({"frame_id", "tool"}).successful);
    bench.run(200, 300);
    CHECK(bench.forces.back().header.frame_id == "tool");
    bench.diagnose();
    CHECK(bench.value("samples") == "100"); // a new one
}

/** An error is not hidden by a topic that has stopped. */
void error_and_stopped() {
    Bench bench;
    bench.run(0, 100);
    JointState message = bench.joints(kStart_ns + 100 * kMs, 0.1);
    message.name = {"yaw", "pitch", "roll"};
    bench.send(message);
    world().steady_ns += 3000 * kMs;
    CHECK(judged(bench.diagnose(), DiagnosticStatus::ERROR, "no position of joint \"insertion\""));
    CHECK(holds(bench.last.message, "measured_cf has stopped"));
}

void second_instance() {
    Bench bench;
    bench.run(0, 100);
    CHECK(judged(bench.diagnose(), DiagnosticStatus::OK, ""));
    const Bench second;
    bench.run(100, 200);
    CHECK(judged(bench.diagnose(), DiagnosticStatus::WARN, "another node publishes /tissue_cf"));
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 3) {
        std::fprintf(stderr, "usage: node_test MODEL.json FOLDER\n");
        return 2;
    }
    model_path = argv[1];
    folder = argv[2];
    publishes_the_estimate();
    mirrored();
    order_of_joints();
    joint_missing();
    topics_stop();
    bad_stamps();
    two_clocks();
    not_a_number();
    bad_models();
    parameters_refused();
    parameters_refused_by_others();
    error_and_stopped();
    second_instance();
    return failed;
}
