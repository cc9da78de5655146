#include <trocar_ros/tissue_force_broadcaster.hpp>

#include <exception>
#include <limits>

#include <pluginlib/class_list_macros.hpp>

#include <trocar_ros/declare.hpp>

namespace trocar_ros {

namespace {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;

/** In the order of Exported. */
constexpr std::array<const char *, 9> kNames{"force.x",  "force.y",  "force.z",      "torque.x", "torque.y",
                                             "torque.z", "variance", "trocar_force", "fault"};

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

} // namespace

CallbackReturn TissueForceBroadcaster::on_init() {
    return read_parameters() ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
}

InterfaceConfiguration TissueForceBroadcaster::command_interface_configuration() const {
    return {interface_configuration_type::NONE, {}};
}

InterfaceConfiguration TissueForceBroadcaster::state_interface_configuration() const {
    return {interface_configuration_type::INDIVIDUAL,
            {parameters_.joint + "/position", parameters_.sensor + "/" + kNames[axis_.component]}};
}

CallbackReturn TissueForceBroadcaster::on_configure(const rclcpp_lifecycle::State &) {
    // They may have been set since they were declared.
    if (!read_parameters()) {
        return CallbackReturn::ERROR;
    }
    if (parameters_.joint.empty() || parameters_.sensor.empty()) {
        RCLCPP_ERROR(get_node()->get_logger(), "joint and sensor must be set");
        return CallbackReturn::ERROR;
    }
    std::string why;
    model_ = parameters_.load(why);
    if (!model_) {
        RCLCPP_ERROR(get_node()->get_logger(), "no tissue force: %s", why.c_str());
        return CallbackReturn::ERROR;
    }
    return make_observer() ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
}

/** Each activation starts a new observer: what happened in between is unknown. */
CallbackReturn TissueForceBroadcaster::on_activate(const rclcpp_lifecycle::State &) {
    return make_observer() ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
}

std::vector<hardware_interface::StateInterface> TissueForceBroadcaster::on_export_state_interfaces() {
    std::vector<hardware_interface::StateInterface> exported;
    exported.reserve(kCount);
    for (std::size_t place = 0; place < kCount; ++place) {
        exported.emplace_back(get_node()->get_name(), kNames[place], &values_[place]);
    }
    return exported;
}

CallbackReturn TissueForceBroadcaster::on_deactivate(const rclcpp_lifecycle::State &) {
    // What nobody computes any more must not look like a measurement.
    export_nothing();
    return CallbackReturn::SUCCESS;
}

std::vector<hardware_interface::CommandInterface> TissueForceBroadcaster::on_export_reference_interfaces() {
    return {};
}

return_type TissueForceBroadcaster::update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &) {
    return return_type::OK;
}

return_type TissueForceBroadcaster::update_and_write_commands(const rclcpp::Time &time, const rclcpp::Duration &) {
    // What cannot be read now is missing, as NaN is.
    const auto state = [this](std::size_t place) { return state_interfaces_[place].get_optional().value_or(kNan); };
    tissue_->add_position(time.nanoseconds(), parameters_.invert_position ? -state(0) : state(0));
    tissue_->add_reading(time.nanoseconds(), axis_.sign * state(1));
    while (const std::optional<Sample> sample = tissue_->next()) {
        if (!sample->estimate) {
            export_nothing();
            return return_type::ERROR;
        }
        values_[axis_.component] = axis_.sign * sample->tissue_force_n();
        values_[kVariance] = sample->variance_n2;
        values_[kTrocarForce] = sample->estimate.trocar_force_n;
        values_[kFault] = sample->estimate.fault;
    }
    return return_type::OK;
}

bool TissueForceBroadcaster::read_parameters() {
    try {
        declare(*get_node(), parameters_);
        return true;
    } catch (const std::exception &error) {
        RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
        return false;
    }
}

bool TissueForceBroadcaster::make_observer() {
    std::string why;
    tissue_ = parameters_.make(*model_, axis_, why);
    if (!tissue_) {
        RCLCPP_ERROR(get_node()->get_logger(), "no tissue force: %s", why.c_str());
    }
    export_nothing();
    return tissue_.has_value();
}

void TissueForceBroadcaster::export_nothing() {
    values_.fill(0.0);
    values_[axis_.component] = kNan;
    values_[kVariance] = std::numeric_limits<double>::infinity();
    values_[kTrocarForce] = kNan;
}

} // namespace trocar_ros

PLUGINLIB_EXPORT_CLASS(trocar_ros::TissueForceBroadcaster, controller_interface::ChainableControllerInterface)
