// The ros2_control broadcaster as a controller manager runs it. Compiled with stubs of ROS 2 (stubs/README.md).
// Usage: broadcaster_test MODEL.json
#include <chrono>
#include <cmath>
#include <initializer_list>
#include <memory>
#include <string>
#include <vector>

#include <trocar_ros/tissue_force_broadcaster.hpp>

#include "check.hpp"
#include "motion.hpp"

using controller_interface::CallbackReturn;
using controller_interface::return_type;

namespace {

std::string model_path;

struct Manager {
    explicit Manager(std::initializer_list<rclcpp::Parameter> given) {
        std::vector<rclcpp::Parameter> overrides(given);
        overrides.emplace_back("force_error_n", 0.1);
        // As ros2_control makes the nodes of controllers.
        broadcaster.give_node(std::make_shared<rclcpp::Node>(
            "tissue", rclcpp::NodeOptions().parameter_overrides(std::move(overrides)).automatically_declare_parameters_from_overrides(true)));
        initialised = broadcaster.on_init();
        configured = broadcaster.on_configure({});
    }

    void activate() {
        using hardware_interface::LoanedStateInterface;
        using hardware_interface::StateInterface;
        broadcaster.assign({LoanedStateInterface(StateInterface("insertion", "position", &position_m)),
                            LoanedStateInterface(StateInterface("ft", "force.z", &force_n))});
        activated = broadcaster.on_activate({});
    }

    return_type update(int tick) {
        position_m = motion::position_m(tick * 1e-3);
        force_n = motion::reading_n(tick * 1e-3, static_cast<unsigned long>(tick));
        return again(tick);
    }

    return_type again(int tick) {
        return broadcaster.update(rclcpp::Time(tick * 1'000'000LL), rclcpp::Duration(std::chrono::milliseconds(1)));
    }

    double exported(const std::string &name) {
        for (const auto &state : broadcaster.exported()) {
            if (state.get_name() == "tissue/" + name) {
                return *state.get_optional();
            }
        }
        CHECK(!"an exported name");
        return 0.0;
    }

    trocar_ros::TissueForceBroadcaster broadcaster;
    double position_m = 0.0;
    double force_n = 0.0;
    CallbackReturn initialised{};
    CallbackReturn configured{};
    CallbackReturn activated{};
};

void exports_the_estimate() {
    Manager manager{{"model_path", model_path}, {"sensor", "ft"}};
    CHECK(manager.configured == CallbackReturn::SUCCESS);
    const auto claimed = manager.broadcaster.state_interface_configuration().names;
    CHECK(claimed == std::vector<std::string>({"insertion/position", "ft/force.z"}));
    manager.activate();
    CHECK(manager.activated == CallbackReturn::SUCCESS && std::isnan(manager.exported("force.z")));
    trocar::CompensatorOptions options;
    options.force_error_n = 0.1;
    trocar::Compensator observer(trocar::Model::load(model_path), options);
    double before_s = 0.0;
    for (int tick = 1; tick < 1000; ++tick) {
        CHECK(manager.update(tick) == return_type::OK);
        const double now_s = static_cast<double>((tick - 1) * 1'000'000LL) / 1e9;
        const trocar::Estimate own = observer.step(manager.position_m, manager.force_n, now_s - before_s);
        before_s = now_s;
        CHECK(manager.exported("force.z") == own.tissue_force_n && manager.exported("force.x") == 0.0);
        CHECK(manager.exported("variance") == own.tissue_force_std_n * own.tissue_force_std_n);
        CHECK(manager.exported("trocar_force") == own.trocar_force_n && manager.exported("fault") == TROCAR_FAULT_NONE);
    }
    // Time stands still: what was is kept. A state that cannot be read: no tissue force, no failure.
    const double kept = manager.exported("force.z");
    CHECK(manager.again(999) == return_type::OK && manager.exported("force.z") == kept);
    manager.broadcaster.assigned()[1].is_locked = true;
    CHECK(manager.update(1000) == return_type::OK && std::isnan(manager.exported("force.z")));
    CHECK(std::isinf(manager.exported("variance")) && manager.exported("fault") == TROCAR_FAULT_NO_READING);
    manager.broadcaster.assigned()[1].is_locked = false;
    CHECK(manager.update(1001) == return_type::OK && std::isfinite(manager.exported("force.z")));
    // Nothing of it stays when nobody computes it any more.
    CHECK(manager.broadcaster.on_deactivate({}) == CallbackReturn::SUCCESS);
    CHECK(std::isnan(manager.exported("force.z")) && std::isinf(manager.exported("variance")));
    manager.activate();
    CHECK(std::isnan(manager.exported("force.z")));
}

void refusals() {
    CHECK(Manager{{"model_path", model_path}}.configured == CallbackReturn::ERROR);
    CHECK(Manager{{"sensor", "ft"}}.configured == CallbackReturn::ERROR);
    CHECK(Manager{{"sensor", "ft"}, {"model_path", "no/such/file.json"}}.configured == CallbackReturn::ERROR);
    CHECK(rclcpp::stub::world().log.back().find("no/such/file.json") != std::string::npos);
    CHECK(Manager{{"sensor", "ft"}, {"model_path", model_path}, {"force_axis", "up"}}.configured ==
          CallbackReturn::ERROR);
    CHECK(Manager{{"sensor", "ft"}, {"model_path", model_path}, {"longest_interval_s", 7.0}}.configured ==
          CallbackReturn::ERROR);
    CHECK(Manager{{"adaptation", 1.0}}.initialised == CallbackReturn::ERROR);
    Manager manager{{"sensor", "ft"}, {"model_path", model_path}};
    CHECK(manager.configured == CallbackReturn::SUCCESS);
    manager.broadcaster.get_node()->set_parameter({"force_axis", "-y"});
    CHECK(manager.broadcaster.on_configure({}) == CallbackReturn::SUCCESS);
    CHECK(manager.broadcaster.state_interface_configuration().names.at(1) == "ft/force.y");
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: broadcaster_test MODEL.json\n");
        return 2;
    }
    model_path = argv[1];
    exports_the_estimate();
    refusals();
    return failed;
}
