/* What a test sees and moves: topics, clocks, timers, the log. Not part of ROS 2. */
#pragma once

#include <algorithm>
#include <any>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace rclcpp::stub {

struct World {
    std::int64_t steady_ns = 0;
    std::int64_t ros_ns = 0;
    std::map<std::string, std::size_t> publishers;
    std::vector<std::pair<const void *, std::function<void()>>> timers;
    std::vector<std::string> log;
    /** A parameter that another callback refuses, after that of the node under test has accepted it. */
    std::string refused_parameter;

    template <typename Message>
    void listen(const void *owner, const std::string &topic, std::function<void(const Message &)> callback) {
        listeners_.push_back({owner, topic, callback});
    }

    template <typename Message> void send(const std::string &topic, const Message &message) {
        // By place: a listener may add others.
        for (std::size_t place = 0; place < listeners_.size(); ++place) {
            using Callback = std::function<void(const Message &)>;
            if (listeners_[place].topic == topic) {
                std::any_cast<const Callback &>(listeners_[place].callback)(message);
            }
        }
    }

    void tick() {
        for (const auto &timer : timers) {
            timer.second();
        }
    }

    void forget(const void *owner) {
        listeners_.erase(std::remove_if(listeners_.begin(), listeners_.end(),
                                        [&](const Listener &listener) { return listener.owner == owner; }),
                         listeners_.end());
        timers.erase(std::remove_if(timers.begin(), timers.end(), [&](const auto &timer) { return timer.first == owner; }),
                     timers.end());
    }

  private:
    struct Listener {
        const void *owner;
        std::string topic;
        std::any callback;
    };
    std::vector<Listener> listeners_;
};

inline World &world() {
    static World only;
    return only;
}

template <typename... Values> std::string text(const char *format, const Values &...values) {
    char buffer[1024];
    std::snprintf(buffer, sizeof buffer, format, values...);
    return buffer;
}

inline void log(const std::string &name, const char *level, const std::string &text) {
    world().log.push_back(std::string(level) + " " + name + ": " + text);
}

} // namespace rclcpp::stub
