/*
 * ROS 2 node: joint state and wrench in, force on the tissue out. docs/reference/ros2.md describes topics, parameters and diagnostics.
 */
#ifndef TROCAR_ROS__TISSUE_FORCE_NODE_HPP_
#define TROCAR_ROS__TISSUE_FORCE_NODE_HPP_

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <rcl_interfaces/msg/set_parameters_result.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rclcpp/version.h>
#include <sensor_msgs/msg/joint_state.hpp>

#include <trocar_ros/health.hpp>
#include <trocar_ros/parameters.hpp>
#include <trocar_ros/setup.hpp>
#include <trocar_ros/tissue_force.hpp>

// From ROS 2 Iron on. Before, a change is applied when it is validated.
#define TROCAR_ROS_HAS_POST_SET RCLCPP_VERSION_GTE(17, 0, 0)

namespace trocar_ros {

class TissueForceNode : public rclcpp::Node {
  public:
    explicit TissueForceNode(const rclcpp::NodeOptions &options);

  private:
    /** What one of the topics subscribed to did; the node's own view, beside the counts of the stream. */
    struct Topic {
        const char *name;
        /** When the last message came, by the steady clock. */
        std::optional<std::int64_t> arrival_ns;
        /** Messages with a stamp of zero, a negative one, or a second or more of nanoseconds. */
        std::uint64_t unstamped = 0;
        /** Joint states without the joint, or without a position for it. */
        std::uint64_t without_joint = 0;
    };

    /** What the counts were at the last report. */
    struct Reported {
        Counts counts;
        std::uint64_t unstamped = 0;
        std::uint64_t without_joint = 0;
        std::uint64_t refused = 0;
    };

    /** Whether a change of parameters is accepted; nothing changes yet. */
    rcl_interfaces::msg::SetParametersResult validate(const std::vector<rclcpp::Parameter> &changes);
    /** Runs the change that was validated: rclcpp has set it. */
    void apply();
    void on_joint_state(const sensor_msgs::msg::JointState &message);
    void on_wrench(const geometry_msgs::msg::WrenchStamped &message);

    std::optional<std::int64_t> stamp(const builtin_interfaces::msg::Time &stamp, Topic &topic);
    std::optional<double> joint_position(const sensor_msgs::msg::JointState &message);
    void publish_samples();
    void publish(const Sample &sample);

    void report();
    Health judge();
    void judge_topics(Health &health) const;
    void judge_samples(Health &health) const;
    void add_values(diagnostic_msgs::msg::DiagnosticStatus &status) const;

    /** Callbacks of one node may run in several threads, and parameters be set from any. */
    std::mutex mutex_;
    Setup<NodeParameters> setup_;
    std::size_t joint_place_ = 0;
    Topic joint_state_{"measured_js", {}, 0, 0};
    Topic wrench_{"measured_cf", {}, 0, 0};
    Reported reported_;
    /** Samples that the C library refused, and the last status. */
    std::uint64_t refused_ = 0;
    trocar::Status last_refusal_ = TROCAR_STATUS_OK;
    /** Kept, so that nothing but the middleware allocates when they are published. */
    geometry_msgs::msg::WrenchStamped force_message_;
    geometry_msgs::msg::WrenchStamped variance_message_;

    mutable rclcpp::Clock steady_clock_{RCL_STEADY_TIME};
    rclcpp::Publisher<geometry_msgs::msg::WrenchStamped>::SharedPtr force_publisher_;
    rclcpp::Publisher<geometry_msgs::msg::WrenchStamped>::SharedPtr variance_publisher_;
    rclcpp::Publisher<diagnostic_msgs::msg::DiagnosticArray>::SharedPtr diagnostics_publisher_;
    rclcpp::Subscription<sensor_msgs::msg::JointState>::SharedPtr joint_state_subscription_;
    rclcpp::Subscription<geometry_msgs::msg::WrenchStamped>::SharedPtr wrench_subscription_;
    rclcpp::TimerBase::SharedPtr timer_;
    rclcpp::node_interfaces::OnSetParametersCallbackHandle::SharedPtr validate_callback_;
#if TROCAR_ROS_HAS_POST_SET
    rclcpp::node_interfaces::PostSetParametersCallbackHandle::SharedPtr apply_callback_;
#endif
};

} // namespace trocar_ros

#endif // TROCAR_ROS__TISSUE_FORCE_NODE_HPP_
