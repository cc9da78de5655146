/*
 * How well the node does: the worst of several findings, and all their reasons. Knows nothing of ROS.
 */
#ifndef TROCAR_ROS__HEALTH_HPP_
#define TROCAR_ROS__HEALTH_HPP_

#include <algorithm>
#include <string>

namespace trocar_ros {

/**
 * From good to worst. Not the order of the numbers in diagnostic_msgs, where STALE is above ERROR: a topic that has
 * stopped may come back by itself, an error needs somebody to correct it, and must not be hidden.
 */
enum class Level { ok, warn, stale, error };

/** The worst level found, and every reason in the order of the findings. */
class Health {
  public:
    void raise(Level level, const std::string &reason) {
        level_ = std::max(level_, level);
        reasons_ += reasons_.empty() ? reason : "; " + reason;
    }

    Level level() const noexcept { return level_; }
    const std::string &reasons() const noexcept { return reasons_; }

  private:
    Level level_ = Level::ok;
    std::string reasons_;
};

} // namespace trocar_ros

#endif // TROCAR_ROS__HEALTH_HPP_
