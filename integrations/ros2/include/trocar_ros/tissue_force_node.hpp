/*
 * ROS 2 node: joint state and wrench in, force on the tissue out. docs/ros2.md describes topics, parameters and diagnostics.
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
#include <sensor_msgs/msg/joint_state.hpp>

#include <trocar_ros/parameters.hpp>
#include <trocar_ros/tissue_force.hpp>

namespace trocar_ros {

/** Those of the observer, and those of the topics. */
struct NodeParameters : Parameters {
    std::string joint = "insertion";
    std::string frame_id;
    bool use_arrival_time = false;
    double stale_after_s = 0.5;

    template <typename Visit> void each(Visit visit) {
        Parameters::each(visit);
        const std::optional<Range> any;
        visit("joint", joint, "Joint along the shaft, by its name in the joint state; its position is in m.", any);
        visit("frame_id", frame_id, "Frame of what is published; empty: that of the wrench received.", any);
        visit("use_arrival_time", use_arrival_time,
              "Whether messages count from when they arrive rather than by header.stamp: for topics stamped by two clocks.",
              any);
        visit("stale_after_s", stale_after_s, "A topic without a message for so long is reported as stale, s.",
              std::optional<Range>({0.05, 60.0}));
    }
};

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

    rcl_interfaces::msg::SetParametersResult on_parameters(const std::vector<rclcpp::Parameter> &changes);
    void on_joint_state(const sensor_msgs::msg::JointState &message);
    void on_wrench(const geometry_msgs::msg::WrenchStamped &message);

    std::optional<std::int64_t> stamp(const builtin_interfaces::msg::Time &stamp, Topic &topic);
    std::optional<double> joint_position(const sensor_msgs::msg::JointState &message);
    void publish_samples();
    void publish(const Sample &sample);

    void report();
    void judge(diagnostic_msgs::msg::DiagnosticStatus &status);
    void judge_topics(diagnostic_msgs::msg::DiagnosticStatus &status);
    void judge_samples(diagnostic_msgs::msg::DiagnosticStatus &status);
    void add_values(diagnostic_msgs::msg::DiagnosticStatus &status) const;

    /** Callbacks of one node may run in several threads, and parameters be set from any. */
    std::mutex mutex_;
    NodeParameters parameters_;
    /** As it was read: what becomes of the file later does not matter. */
    std::optional<trocar::Model> model_;
    std::optional<TissueForce> tissue_;
    /** Why there is no observer. */
    std::string refusal_;
    Axis axis_;
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

    rclcpp::Clock steady_clock_{RCL_STEADY_TIME};
    rclcpp::Publisher<geometry_msgs::msg::WrenchStamped>::SharedPtr force_publisher_;
    rclcpp::Publisher<geometry_msgs::msg::WrenchStamped>::SharedPtr variance_publisher_;
    rclcpp::Publisher<diagnostic_msgs::msg::DiagnosticArray>::SharedPtr diagnostics_publisher_;
    rclcpp::Subscription<sensor_msgs::msg::JointState>::SharedPtr joint_state_subscription_;
    rclcpp::Subscription<geometry_msgs::msg::WrenchStamped>::SharedPtr wrench_subscription_;
    rclcpp::TimerBase::SharedPtr timer_;
    rclcpp::node_interfaces::OnSetParametersCallbackHandle::SharedPtr parameters_callback_;
};

} // namespace trocar_ros

#endif // TROCAR_ROS__TISSUE_FORCE_NODE_HPP_
