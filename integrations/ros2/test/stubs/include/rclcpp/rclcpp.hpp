/* Stub for tests, no ROS 2: see ../../README.md. */
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include <builtin_interfaces/msg/time.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>
#include <rcl_interfaces/msg/set_parameters_result.hpp>

#include <rclcpp/stub.hpp>
#include <rclcpp/version.h>

enum rcl_clock_type_t { RCL_ROS_TIME = 1, RCL_SYSTEM_TIME = 2, RCL_STEADY_TIME = 3 };

#define RCLCPP_ERROR(logger, ...) rclcpp::stub::log((logger).name, "ERROR", rclcpp::stub::text(__VA_ARGS__))

namespace rclcpp {

struct Logger {
    std::string name;
};

class Time {
  public:
    explicit Time(std::int64_t nanoseconds = 0) : nanoseconds_(nanoseconds) {}
    std::int64_t nanoseconds() const { return nanoseconds_; }

  private:
    std::int64_t nanoseconds_;
};

class Duration {
  public:
    explicit Duration(std::chrono::nanoseconds duration) : duration_(duration) {}
    std::int64_t nanoseconds() const { return duration_.count(); }

  private:
    std::chrono::nanoseconds duration_;
};

class Clock {
  public:
    using SharedPtr = std::shared_ptr<Clock>;
    explicit Clock(rcl_clock_type_t type = RCL_SYSTEM_TIME) : type_(type) {}
    Time now() { return Time(type_ == RCL_STEADY_TIME ? stub::world().steady_ns : stub::world().ros_ns); }

  private:
    rcl_clock_type_t type_;
};

class QoS {
  public:
    explicit QoS(std::size_t depth) : depth_(depth) {}
    std::size_t depth() const { return depth_; }

  private:
    std::size_t depth_;
};

class SensorDataQoS : public QoS {
  public:
    SensorDataQoS() : QoS(5) {}
};

class ParameterValue {
  public:
    std::variant<std::monostate, bool, std::int64_t, double, std::string> value;
};

class Parameter {
  public:
    template <typename Value> Parameter(std::string name, Value value) : name_(std::move(name)) {
        if constexpr (std::is_convertible_v<Value, std::string>) {
            value_.value = std::string(value);
        } else {
            value_.value = value;
        }
    }
    const std::string &get_name() const { return name_; }
    template <typename Value> Value get_value() const { return std::get<Value>(value_.value); }
    std::size_t kind() const { return value_.value.index(); }

  private:
    std::string name_;
    ParameterValue value_;
};

namespace exceptions {
class InvalidParameterValueException : public std::runtime_error {
    using std::runtime_error::runtime_error;
};
class ParameterAlreadyDeclaredException : public std::runtime_error {
    using std::runtime_error::runtime_error;
};
} // namespace exceptions

class NodeOptions {
  public:
    NodeOptions &parameter_overrides(std::vector<Parameter> overrides) {
        overrides_ = std::move(overrides);
        return *this;
    }
    const std::vector<Parameter> &parameter_overrides() const { return overrides_; }
    NodeOptions &automatically_declare_parameters_from_overrides(bool declares) {
        declares_ = declares;
        return *this;
    }
    bool automatically_declare_parameters_from_overrides() const { return declares_; }

  private:
    std::vector<Parameter> overrides_;
    bool declares_ = false;
};

template <typename Message> class Publisher {
  public:
    using SharedPtr = std::shared_ptr<Publisher>;
    explicit Publisher(std::string topic) : topic_(std::move(topic)) { ++stub::world().publishers[topic_]; }
    ~Publisher() { --stub::world().publishers[topic_]; }
    Publisher(const Publisher &) = delete;
    const char *get_topic_name() const { return topic_.c_str(); }
    void publish(const Message &message) { stub::world().send(topic_, message); }

  private:
    std::string topic_;
};

template <typename Message> class Subscription {
  public:
    using SharedPtr = std::shared_ptr<Subscription>;
};

class TimerBase {
  public:
    using SharedPtr = std::shared_ptr<TimerBase>;
    virtual ~TimerBase() = default;
};

namespace node_interfaces {
struct OnSetParametersCallbackHandle {
    using SharedPtr = std::shared_ptr<OnSetParametersCallbackHandle>;
    std::function<rcl_interfaces::msg::SetParametersResult(const std::vector<Parameter> &)> callback;
};
#if RCLCPP_VERSION_GTE(17, 0, 0)
struct PostSetParametersCallbackHandle {
    using SharedPtr = std::shared_ptr<PostSetParametersCallbackHandle>;
    std::function<void(const std::vector<Parameter> &)> callback;
};
#endif
} // namespace node_interfaces

class Node {
  public:
    Node(const std::string &name, const NodeOptions &options) : name_("/" + name), options_(options) {
        if (options.automatically_declare_parameters_from_overrides()) {
            for (const Parameter &given : options.parameter_overrides()) {
                parameters_.insert_or_assign(given.get_name(), given);
                descriptors_[given.get_name()];
            }
        }
    }
    virtual ~Node() { stub::world().forget(this); }
    Node(const Node &) = delete;

    Logger get_logger() const { return {name_}; }
    const char *get_name() const { return name_.c_str() + 1; }
    const char *get_fully_qualified_name() const { return name_.c_str(); }
    Clock::SharedPtr get_clock() { return clock_; }
    std::size_t count_publishers(const std::string &topic) const { return stub::world().publishers[topic]; }

    bool has_parameter(const std::string &name) const { return parameters_.count(name) > 0; }

    template <typename Value>
    Value declare_parameter(const std::string &name, const Value &initial,
                            const rcl_interfaces::msg::ParameterDescriptor &descriptor = {}) {
        if (has_parameter(name)) {
            throw exceptions::ParameterAlreadyDeclaredException(name + " is declared already");
        }
        Parameter parameter(name, initial);
        for (const Parameter &given : options_.parameter_overrides()) {
            parameter = given.get_name() == name ? given : parameter;
        }
        const std::string reason = refusal(parameter, Parameter(name, initial).kind(), descriptor);
        if (!reason.empty()) {
            throw exceptions::InvalidParameterValueException(reason);
        }
        descriptors_.insert_or_assign(name, descriptor);
        parameters_.insert_or_assign(name, parameter);
        return parameter.get_value<Value>();
    }

    template <typename Value> bool get_parameter(const std::string &name, Value &value) const {
        const auto found = parameters_.find(name);
        if (found == parameters_.end()) {
            return false;
        }
        value = found->second.template get_value<Value>();
        return true;
    }

    rcl_interfaces::msg::SetParametersResult set_parameter(const Parameter &parameter) {
        rcl_interfaces::msg::SetParametersResult result;
        const auto found = parameters_.find(parameter.get_name());
        if (found == parameters_.end()) {
            result.reason = parameter.get_name() + " is not declared";
            return result;
        }
        result.reason = refusal(parameter, found->second.kind(), descriptors_.at(parameter.get_name()));
        result.successful = result.reason.empty();
        if (const auto handle = on_parameters_.lock(); result.successful && handle) {
            result = handle->callback({parameter});
        }
        if (stub::world().refused_parameter == parameter.get_name()) {
            result.successful = false;
            result.reason = "refused by another callback";
        }
        if (result.successful) {
            found->second = parameter;
            if (after_parameters_) {
                after_parameters_({parameter});
            }
        }
        return result;
    }

    const std::map<std::string, rcl_interfaces::msg::ParameterDescriptor> &descriptors() const { return descriptors_; }

    node_interfaces::OnSetParametersCallbackHandle::SharedPtr add_on_set_parameters_callback(
        std::function<rcl_interfaces::msg::SetParametersResult(const std::vector<Parameter> &)> callback) {
        const auto handle = std::make_shared<node_interfaces::OnSetParametersCallbackHandle>();
        handle->callback = std::move(callback);
        on_parameters_ = handle;
        return handle;
    }

#if RCLCPP_VERSION_GTE(17, 0, 0)
    node_interfaces::PostSetParametersCallbackHandle::SharedPtr
    add_post_set_parameters_callback(std::function<void(const std::vector<Parameter> &)> callback) {
        const auto handle = std::make_shared<node_interfaces::PostSetParametersCallbackHandle>();
        handle->callback = std::move(callback);
        after_parameters_ = [weak = std::weak_ptr(handle)](const std::vector<Parameter> &parameters) {
            if (const auto alive = weak.lock()) {
                alive->callback(parameters);
            }
        };
        return handle;
    }
#endif

    template <typename Message>
    typename Publisher<Message>::SharedPtr create_publisher(const std::string &topic, const QoS &) {
        return std::make_shared<Publisher<Message>>(topic.front() == '/' ? topic : "/" + topic);
    }

    template <typename Message, typename Callback>
    typename Subscription<Message>::SharedPtr create_subscription(const std::string &topic, const QoS &, Callback callback) {
        stub::world().listen<Message>(this, "/" + topic, [callback](const Message &message) {
            callback(std::make_shared<const Message>(message));
        });
        return std::make_shared<Subscription<Message>>();
    }

    template <typename Period> TimerBase::SharedPtr create_wall_timer(Period, std::function<void()> callback) {
        stub::world().timers.emplace_back(this, std::move(callback));
        return std::make_shared<TimerBase>();
    }

  private:
    /** Why rclcpp would refuse a value: another type, or outside of its range; NaN as newer releases do. */
    static std::string refusal(const Parameter &parameter, std::size_t kind,
                               const rcl_interfaces::msg::ParameterDescriptor &descriptor) {
        if (parameter.kind() != kind) {
            return "parameter '" + parameter.get_name() + "' has another type";
        }
        for (const auto &range : descriptor.floating_point_range) {
            const double value = parameter.get_value<double>();
            if (!(value >= range.from_value && value <= range.to_value)) {
                return "parameter '" + parameter.get_name() + "' doesn't comply with floating point range";
            }
        }
        return "";
    }

    std::string name_;
    NodeOptions options_;
    Clock::SharedPtr clock_ = std::make_shared<Clock>(RCL_ROS_TIME);
    std::map<std::string, Parameter> parameters_;
    std::map<std::string, rcl_interfaces::msg::ParameterDescriptor> descriptors_;
    std::weak_ptr<node_interfaces::OnSetParametersCallbackHandle> on_parameters_;
    std::function<void(const std::vector<Parameter> &)> after_parameters_;
};

} // namespace rclcpp
