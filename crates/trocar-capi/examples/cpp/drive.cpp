// Runs a model along a motion and prints one force (N) a row. Usage: drive MODEL.json MOTION.csv
//
// The motion has a header and the columns time_s,position_m. The first row is where the seal rests; every other is
// stepped to; a row with the time and position of the one before repeats the force.
#include <cstdio>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <string>

#include <trocar.hpp>

static void run(const std::string &model_path, const std::string &motion_path) {
    const trocar::Model model = trocar::Model::load(model_path);
    std::ifstream motion(motion_path);
    std::string line;
    if (!std::getline(motion, line) || line.rfind("time_s,position_m", 0) != 0) {
        throw std::runtime_error(motion_path + ": the header must be time_s,position_m");
    }
    std::optional<trocar::State> seal;
    double last_time_s = 0.0;
    while (std::getline(motion, line)) {
        std::size_t comma = 0;
        const double time_s = std::stod(line, &comma);
        const double position_m = std::stod(line.substr(comma + 1));
        if (!seal) {
            seal.emplace(model, position_m);
        } else if (time_s != last_time_s || position_m != seal->position_m()) {
            const trocar::Step step = seal->step_to(position_m, time_s - last_time_s);
            if (!step) {
                throw std::runtime_error(line + ": " + trocar::message(step.status));
            }
        }
        last_time_s = time_s;
        std::printf("%.17g\n", seal->force_n());
    }
}

int main(int argc, char **argv) {
    if (argc != 3) {
        std::fprintf(stderr, "usage: drive MODEL.json MOTION.csv\n");
        return 2;
    }
    try {
        run(argv[1], argv[2]);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
    return 0;
}
