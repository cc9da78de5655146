// As examples/c/compensate.c, with the C++ wrapper. Usage: compensate MODEL.json READINGS.csv [FORCE_ERROR_N
// [MOVING_MASS_KG [SENSOR_LIMIT_N]]]
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

#include <trocar.hpp>

int main(int argc, char **argv) try {
    if (argc < 3) {
        std::fprintf(stderr, "usage: compensate MODEL.json READINGS.csv [FORCE_ERROR_N [MOVING_MASS_KG [SENSOR_LIMIT_N]]]\n");
        return 2;
    }
    const auto given = [&](int k) { return argc > k ? std::optional(std::atof(argv[k])) : std::nullopt; };
    trocar::CompensatorOptions options;
    options.force_error_n = given(3);
    options.moving_mass_kg = given(4);
    options.sensor_limit_n = given(5);
    trocar::Compensator observer(trocar::Model::load(argv[1]), options);

    std::ifstream readings(argv[2]);
    std::string line;
    std::getline(readings, line);
    double before_s = 0.0;
    for (bool first = true; std::getline(readings, line); first = false) {
        double time_s = 0.0;
        double position_m = 0.0;
        double force_n = 0.0;
        if (std::sscanf(line.c_str(), "%lf,%lf,%lf", &time_s, &position_m, &force_n) != 3) {
            std::fprintf(stderr, "three numbers expected: %s\n", line.c_str());
            return 1;
        }
        const trocar::Estimate now = observer.step(position_m, force_n, first ? 0.0 : time_s - before_s);
        if (!now) {
            std::fprintf(stderr, "%s\n", trocar::message(now.status));
            return 1;
        }
        before_s = time_s;
        std::printf("%.17g,%.17g,%.17g,%d,%d\n", now.trocar_force_n, now.tissue_force_n, now.tissue_force_std_n,
                    static_cast<int>(now.adapting), static_cast<int>(now.fault));
    }
    return 0;
} catch (const trocar::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
