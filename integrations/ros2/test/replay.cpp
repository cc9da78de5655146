// Messages through the library without ROS, in the order in which they arrived. Reads lines "position STAMP_NS VALUE" and
// "reading STAMP_NS VALUE" from standard input; prints one sample per line. Usage: replay MODEL.json
// FORCE_ERROR_N LONGEST_INTERVAL_S
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>

#include <trocar_ros/tissue_force.hpp>

int main(int argc, char **argv) try {
    if (argc != 4) {
        std::fprintf(stderr, "usage: replay MODEL.json FORCE_ERROR_N LONGEST_INTERVAL_S\n");
        return 2;
    }
    trocar_ros::Settings settings;
    settings.compensator.force_error_n = std::atof(argv[2]);
    settings.longest_interval_s = std::atof(argv[3]);
    trocar_ros::TissueForce tissue(trocar::Model::load(argv[1]), settings);
    std::string kind;
    std::string value;
    std::int64_t stamp_ns = 0;
    while (std::cin >> kind >> stamp_ns >> value) {
        // Not by the stream, which refuses nan.
        if (kind == "position") {
            tissue.add_position(stamp_ns, std::strtod(value.c_str(), nullptr));
        } else {
            tissue.add_reading(stamp_ns, std::strtod(value.c_str(), nullptr));
        }
        while (const auto sample = tissue.next()) {
            std::printf("%" PRId64 ",%.17g,%.17g,%.17g,%.17g,%.17g,%d,%d\n", sample->stamp_ns, sample->position_m,
                        sample->reading_n, sample->estimate.trocar_force_n, sample->tissue_force_n(),
                        sample->estimate.tissue_force_std_n, static_cast<int>(sample->estimate.adapting),
                        static_cast<int>(sample->estimate.fault));
        }
    }
    return 0;
} catch (const trocar::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
