/*
 * Along which axis of a wrench the shaft of the instrument lies, and which way insertion is.
 */
#ifndef TROCAR_ROS__AXIS_HPP_
#define TROCAR_ROS__AXIS_HPP_

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>

namespace trocar_ros {

/** An axis of a frame with a direction: "x", "y", "z", "-x", "-y" or "-z" points in the direction of insertion. */
struct Axis {
    /** 0 for x, 1 for y, 2 for z. */
    std::size_t component = 2;
    /** 1 or -1. */
    double sign = 1.0;

    static std::optional<Axis> parse(std::string_view name) noexcept {
        const double sign = name.substr(0, 1) == "-" ? -1.0 : 1.0;
        name.remove_prefix(sign < 0.0 ? 1 : 0);
        if (name != "x" && name != "y" && name != "z") {
            return std::nullopt;
        }
        return Axis{static_cast<std::size_t>(name[0] - 'x'), sign};
    }

    /** Along the axis, of a vector in the frame. */
    double of(const std::array<double, 3> &vector) const noexcept { return sign * vector[component]; }

    /** A vector in the frame with value along the axis, and nothing across it. */
    std::array<double, 3> along(double value) const noexcept {
        std::array<double, 3> vector{};
        vector[component] = sign * value;
        return vector;
    }
};

} // namespace trocar_ros

#endif // TROCAR_ROS__AXIS_HPP_
