/* A made-up motion and reading, for tests and the benchmark. */
#ifndef TROCAR_ROS__TEST__MOTION_HPP_
#define TROCAR_ROS__TEST__MOTION_HPP_

#include <cmath>

namespace motion {

constexpr double kPi = 3.14159265358979323846;

/** Strokes of 40 mm every 3 s with a tremor of 0.2 mm at 9 Hz, m. */
inline double position_m(double time_s) {
    return 0.1 - 0.02 * std::cos(2.0 * kPi * time_s / 3.0) + 0.2e-3 * std::sin(2.0 * kPi * 9.0 * time_s);
}

/** Friction with a hysteresis of some millimetres, and noise of 20 mN that repeats: no true reading, but as rough as one, N. */
inline double reading_n(double time_s, unsigned long tick) {
    const double velocity_m_s = (position_m(time_s) - position_m(time_s - 1e-3)) / 1e-3;
    const double noise = static_cast<double>((tick * 2654435761UL) % 1000UL) / 1000.0 - 0.5;
    return 3.0 * std::tanh(velocity_m_s / 5e-3) + 5.0 * velocity_m_s + 0.07 * noise;
}

} // namespace motion

#endif // TROCAR_ROS__TEST__MOTION_HPP_
