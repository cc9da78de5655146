/* Stub for tests, no ROS 2: see ../../README.md. Follows hardware_interface/handle.hpp and loaned_state_interface.hpp of ros2_control
 * 4.27.0 (ROS 2 Jazzy). */
#pragma once

#include <optional>
#include <string>

namespace hardware_interface {

class StateInterface {
  public:
    StateInterface(const std::string &prefix, const std::string &name, double *value)
        : name_(prefix + "/" + name), value_(value) {}
    const std::string &get_name() const { return name_; }
    template <typename Value = double> [[nodiscard]] std::optional<Value> get_optional() const { return *value_; }

  private:
    std::string name_;
    double *value_;
};

class CommandInterface {};

class LoanedStateInterface {
  public:
    explicit LoanedStateInterface(const StateInterface &lent) : lent_(lent) {}
    template <typename Value = double> [[nodiscard]] std::optional<Value> get_optional(unsigned int = 10) const {
        return is_locked ? std::nullopt : lent_.get_optional<Value>();
    }
    /** For tests: the hardware holds the value. */
    bool is_locked = false;

  private:
    StateInterface lent_;
};

} // namespace hardware_interface
