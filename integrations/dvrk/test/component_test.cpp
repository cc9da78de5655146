// The dVRK component, run period by period. Compiled with stubs of cisst (stubs/README.md). Usage: component_test MODEL.json FOLDER
#include <cmath>
#include <fstream>
#include <initializer_list>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <mtsTrocarForce.h>

#include "check.hpp"
#include "motion.hpp"

namespace {

std::string model_path;
std::string folder;

/** An arm whose shaft points along (0.6, 0, -0.8) of the reference, with a bent wrist, and a sensor on it. */
class Robot {
  public:
    explicit Robot(const std::string &more = "", const std::string &model = model_path)
        : component(mtsTaskPeriodicConstructorArg{"TrocarForce", 0.001}) {
        const std::string config = folder + "/trocar-force.json";
        std::ofstream(config) << "{\"model_path\": \"" << model << "\", \"force_error_n\": 0.1" << more << "}";
        auto &arm = component.required["PSM"].functions;
        arm.at("measured_js")->source = &joints;
        arm.at("measured_cp")->source = &pose;
        arm.at("body/jacobian")->source = &jacobian;
        component.required["ForceSensor"].functions.at("measured_cf")->source = &sensor;
        joints.Name().SetSize(3);
        joints.Name()[0] = "yaw";
        joints.Name()[1] = "pitch";
        joints.Name()[2] = "insertion";
        joints.Position().SetSize(3);
        for (mtsGenericObject *read : std::initializer_list<mtsGenericObject *>{&joints, &pose, &sensor}) {
            read->SetValid(true);
        }
        // Tip turned by 90 degrees about y: x of the tip is -z of the reference, z of the tip is x of it.
        vctMatRot3 &rotation = pose.Position().Rotation();
        rotation.Element(0, 0) = rotation.Element(2, 2) = 0.0;
        rotation.Element(0, 2) = 1.0;
        rotation.Element(2, 0) = -1.0;
        jacobian.Element(0, 2) = 0.8;
        jacobian.Element(2, 2) = 0.6;
        jacobian.Element(0, 0) = 0.11; // a revolute joint: a lever arm
        component.Configure(config);
    }

    void run(int tick, int end) {
        for (; tick < end; ++tick) {
            const double time_s = tick * 1e-3;
            joints.SetTimestamp(time_s);
            joints.Position()[2] = joint_sign * motion::position_m(time_s);
            sensor.SetTimestamp(time_s);
            sensor.Force()[0] = 9.0;
            sensor.Force()[2] = motion::reading_n(time_s, static_cast<unsigned long>(tick));
            component.period(time_s + delay_s);
        }
    }

    const prmForceCartesianGet &force() {
        return *static_cast<const prmForceCartesianGet *>(component.provided["TissueForce"].commands.at("measured_cf"));
    }
    double variance() { return *static_cast<const double *>(component.provided["TissueForce"].commands.at("variance")); }
    bool said(const std::string &part) {
        const auto &messages = component.provided["TissueForce"].messages;
        return !messages.empty() && messages.back().find(part) != std::string::npos;
    }
    std::string last() {
        const auto &messages = component.provided["TissueForce"].messages;
        return messages.empty() ? "" : messages.back();
    }
    std::size_t messages() { return component.provided["TissueForce"].messages.size(); }

    double joint_sign = 1.0;
    /** By how much arm and sensor are older than the period that reads them, s. */
    double delay_s = 0.0;
    mtsTrocarForce component;
    prmStateJoint joints;
    prmPositionCartesianGet pose;
    prmForceCartesianGet sensor;
    vctDoubleMat jacobian{6, 6};
};

void along_the_shaft() {
    Robot robot;
    trocar::CompensatorOptions options;
    options.force_error_n = 0.1;
    trocar::Compensator observer(trocar::Model::load(model_path), options);
    double own_n = 0.0;
    for (int tick = 0; tick < 1000; ++tick) {
        robot.run(tick, tick + 1);
        const double time_s = tick * 1e-3;
        own_n = observer
                    .step(motion::position_m(time_s), motion::reading_n(time_s, static_cast<unsigned long>(tick)),
                          tick == 0 ? 0.0 : 1e-3)
                    .tissue_force_n;
        CHECK(robot.force().Valid() && std::abs(robot.force().Timestamp() - time_s) < 1e-9);
        CHECK(std::abs(robot.force().Force()[0] - 0.6 * own_n) < 1e-9 && std::abs(robot.force().Force()[1]) < 1e-12);
        CHECK(std::abs(robot.force().Force()[2] + 0.8 * own_n) < 1e-9 && robot.force().Force()[5] == 0.0);
        CHECK(robot.variance() > 0.0 && std::isfinite(robot.variance()));
    }
    CHECK(robot.messages() == 1 && robot.said("tissue force is estimated"));
    // A configuration that is refused changes nothing.
    robot.component.Configure(folder + "/no-such-file.json");
    CHECK(robot.said("cannot be read"));
    robot.run(1000, 1001);
    CHECK(robot.force().Valid());
}

/** A force that is not determined is not valid, and the reason is reported once. */
void not_valid() {
    Robot robot;
    robot.run(0, 200);
    robot.sensor.SetValid(false);
    robot.run(200, 400);
    CHECK(!robot.force().Valid() && std::isinf(robot.variance()) && robot.force().Force()[0] == 0.0);
    const std::size_t count = robot.messages();
    robot.run(400, 800);
    CHECK(!robot.force().Valid() && robot.messages() == count);
    robot.sensor.SetValid(true);
    robot.run(800, 1000);
    CHECK(robot.force().Valid() && robot.said("tissue force is estimated"));
    // Neither arm nor sensor give anything new: a force that is held would be felt.
    robot.component.period(1.5);
    CHECK(!robot.force().Valid() && robot.said("no new pair"));
    robot.run(1501, 1600);
    robot.pose.SetValid(false);
    robot.run(1600, 1601);
    CHECK(!robot.force().Valid() && robot.said("measured_cp"));
    robot.pose.SetValid(true);
    robot.component.required["PSM"].functions.at("measured_js")->source = nullptr;
    robot.run(1601, 1800);
    CHECK(!robot.force().Valid());
}

/** A force bears the time of its samples, not that of the period: what is old looks old. */
void old_force() {
    Robot robot;
    robot.delay_s = 0.08;
    robot.run(0, 200);
    CHECK(robot.force().Valid() && std::abs(robot.force().Timestamp() - 0.199) < 1e-9);
    // Nothing new for 15 ms more, which is still allowed.
    robot.component.period(0.294);
    CHECK(robot.force().Valid() && std::abs(robot.force().Timestamp() - 0.199) < 1e-9);
    robot.component.period(0.3);
    CHECK(!robot.force().Valid() && robot.said("no new pair"));
}

/** Readings of the opposite sign give no force. */
void opposite_sign() {
    Robot robot;
    Robot other(", \"flip_force\": \"yes\"");
    robot.run(0, 12000);
    other.run(0, 12000);
    CHECK(robot.force().Valid() && !other.force().Valid() && other.said("opposite sign"));
}

/** A joint that disappears is named; a message whose stamp is no time is ignored. */
void lost_joint_and_stamp() {
    Robot robot;
    robot.run(0, 200);
    robot.joints.Name()[2] = "outer_insertion";
    robot.run(200, 201);
    CHECK(!robot.force().Valid() && robot.said("joint \"insertion\" is no longer in measured_js"));
    robot.joints.Name()[2] = "insertion";
    robot.run(201, 400);
    CHECK(robot.force().Valid());
    for (const double stamp_s : {std::nan(""), std::numeric_limits<double>::infinity(), 1e300}) {
        robot.joints.SetTimestamp(stamp_s);
        robot.sensor.SetTimestamp(stamp_s);
        robot.component.period(0.4);
        CHECK(robot.force().Valid() && std::abs(robot.force().Timestamp() - 0.399) < 1e-9);
    }
    robot.run(400, 600);
    CHECK(robot.force().Valid() && std::abs(robot.force().Timestamp() - 0.599) < 1e-9);
}

/** Forces of a robot over a second. */
std::vector<double> forces(Robot &robot) {
    std::vector<double> all;
    for (int tick = 0; tick < 1000; ++tick) {
        robot.run(tick, tick + 1);
        all.push_back(robot.force().Force()[0]);
    }
    return all;
}

/** A joint whose position falls on insertion: the same motion of the instrument, and the same force. */
void joint_the_other_way() {
    Robot plain;
    Robot other(", \"invert_position\": true");
    other.joint_sign = -1.0;
    other.jacobian.Element(0, 2) = -0.8;
    other.jacobian.Element(2, 2) = -0.6;
    CHECK(forces(plain) == forces(other) && other.force().Valid());
}

/** The weight of the moving mass, along a shaft that is vertical. */
void gravity() {
    constexpr double kMass_kg = 0.1;
    constexpr double kGravity_m_s2 = -9.81;
    Robot robot(", \"moving_mass_kg\": 0.1, \"gravity_m_s2\": -9.81");
    trocar::CompensatorOptions options;
    options.force_error_n = 0.1;
    options.moving_mass_kg = kMass_kg;
    options.gravity_m_s2 = kGravity_m_s2;
    trocar::Compensator observer(trocar::Model::load(model_path), options);
    const std::vector<double> along_x = forces(robot);
    double before_s = 0.0;
    for (std::size_t tick = 0; tick < along_x.size(); ++tick) {
        const double time_s = static_cast<double>(tick) * 1e-3;
        const double exact_s = static_cast<double>(tick * 1'000'000) / 1e9; // of the stamp, which is in ns
        const double own_n =
            observer.step(motion::position_m(time_s), motion::reading_n(time_s, tick), exact_s - before_s).tissue_force_n;
        before_s = exact_s;
        CHECK(std::abs(along_x[tick] - 0.6 * own_n) < 1e-9);
    }
    Robot without(", \"moving_mass_kg\": 0.1");
    const double difference_n = (forces(without).back() - along_x.back()) / 0.6;
    CHECK(std::abs(std::abs(difference_n) - kMass_kg * 9.81) < 0.05);
}

void refused() {
    Robot joint(", \"joint\": \"yaw\"");
    joint.run(0, 100);
    CHECK(!joint.force().Valid() && joint.said("is not prismatic"));
    Robot missing(", \"joint\": \"elbow\"");
    missing.run(0, 300);
    CHECK(!missing.force().Valid() && missing.said("elbow"));
    Robot axis(", \"force_axis\": \"w\"");
    axis.run(0, 100);
    CHECK(!axis.force().Valid() && axis.said("force_axis must be"));
    for (const auto &[more, reason] : {
             std::pair<const char *, const char *>{"\"longest_interval_s\": \"soon\"",
                                                   "trocar-force.json: longest_interval_s must be a number, got \"soon\""},
             {"\"longest_interval_s\": 2", "longest_interval_s must be from"},
             {"\"longest_age_s\": 0", "longest_age_s must be from 0.001 to 60.0, got 0"},
             {"\"longest_age_s\": -0.1", "longest_age_s must be from 0.001 to 60.0, got -0.1"},
             {"\"longest_age_s\": true", "longest_age_s must be a number, got true"},
             {"\"longest_age_s\": 1e999", "is not a number"},
             {"\"adaptation\": \"no\"", "adaptation must be true or false, got \"no\""},
             {"\"adaptation\": 1", "adaptation must be true or false, got 1"},
             {"\"joint\": 3", "joint must be a string, got 3"},
             {"\"longest_age\": 0.2", "unknown key \"longest_age\"; the keys are model_path, force_axis"},
             {"\"flip_force\": \"maybe\"", "flip_force must be model, yes or no, got \"maybe\""},
             {"\"gravity_m_s2\": 98.1", "gravity_m_s2 must be from -20.0 to 20.0, got 98.1"},
             {"\"moving_mass_kg\": -1", "moving_mass"},
             {"\"force_error_n\": 0.2", "uplicate key"},
         }) {
        Robot robot(std::string(", ") + more);
        robot.run(0, 100);
        const bool is_so = !robot.force().Valid() && robot.said(reason);
        CHECK(is_so || (std::fprintf(stderr, "%s: \"%s\"\n", more, robot.last().c_str()), false));
    }
    Robot model("", "no/such/model.json");
    model.run(0, 100);
    CHECK(!model.force().Valid() && model.said("no/such/model.json"));
    model.component.Configure(folder + "/no-such-file.json");
    CHECK(model.said("cannot be read"));
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 3) {
        std::fprintf(stderr, "usage: component_test MODEL.json FOLDER\n");
        return 2;
    }
    model_path = argv[1];
    folder = argv[2];
    along_the_shaft();
    not_valid();
    old_force();
    opposite_sign();
    lost_joint_and_stamp();
    joint_the_other_way();
    gravity();
    refused();
    return failed;
}
