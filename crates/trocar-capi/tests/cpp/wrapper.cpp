// The C++ wrapper: owners, refusals, tuning, saving. Compiled with and without exceptions. Usage: wrapper MODEL.json
#include <cmath>
#include <cstdio>
#include <limits>
#include <thread>
#include <type_traits>
#include <utility>

#include <trocar.hpp>

static int failed = 0;

#define CHECK(condition)                                                                                              \
    do {                                                                                                              \
        if (!(condition)) {                                                                                           \
            std::fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                                      \
            failed = 1;                                                                                               \
        }                                                                                                             \
    } while (0)

static_assert(noexcept(std::declval<trocar::State &>().step(0.0, 0.0)));
static_assert(noexcept(std::declval<trocar::State &>().step_to(0.0, 0.0)));
static_assert(noexcept(std::declval<trocar::State &>().step_velocity(0.0, 0.0)));
static_assert(noexcept(std::declval<const trocar::State &>().force_n()));
static_assert(std::is_copy_constructible_v<trocar::State> && std::is_nothrow_move_constructible_v<trocar::Model>);

static void steps(const trocar::Model &model) {
    auto seal = trocar::State::try_at(model, 0.1);
    CHECK(seal.has_value());
    CHECK(!trocar::State::try_at(model, std::nan("")));
    const trocar::Step done = seal->step(5e-4, 0.1);
    CHECK(done && done.force_n == seal->force_n() && seal->position_m() == 0.1 + 5e-4);
    CHECK(seal->mode() == trocar::Mode::deforming && *seal->deflection_m() > 0.0);

    const trocar::Step refused = seal->step(std::numeric_limits<double>::infinity(), 1e-3);
    CHECK(!refused && refused.status == TROCAR_STATUS_NOT_FINITE && refused.force_n == done.force_n);
    CHECK(seal->step(1e-5, 0.0).status == TROCAR_STATUS_DURATION_NOT_POSITIVE);

    // A copy goes its own way; a restored state goes the way of the saved one.
    trocar::State copy = *seal;
    const trocar::Numbers saved = seal->save();
    const double ahead = seal->step(1e-3, 1e-2).force_n;
    CHECK(copy.force_n() == done.force_n && copy.step(1e-3, 1e-2).force_n == ahead);
    CHECK(copy.restore(saved) == TROCAR_STATUS_OK && copy.step_velocity(0.1, 1e-2).force_n == ahead);
    CHECK(copy.rest_at_force(0.1, 1.0) == TROCAR_STATUS_OK && std::abs(copy.force_n() - 1.0) < 1e-9);
    CHECK(copy.rest_at_deflection(0.1, 1e-3) == TROCAR_STATUS_OK && std::abs(*copy.deflection_m() - 1e-3) < 1e-12);
}

static void tuning(const trocar::Model &model) {
    std::vector<double> values;
    for (const trocar::Tunable &tunable : model.tunables()) {
        values.push_back(tunable.value);
    }
    CHECK(!values.empty() && model.tunables()[1].name == "insertion_coulomb_force_n");
    auto seal = trocar::State::try_at(model, 0.0);
    auto same = trocar::State::try_at(*model.try_tuned(values), 0.0);
    CHECK(seal->step(0.03, 1.0).force_n == same->step(0.03, 1.0).force_n);

    values[1] *= 2.0;
    CHECK(seal->use(*model.try_tuned(values)) == TROCAR_STATUS_OK);
    const double before = seal->force_n();
    CHECK(seal->step(0.03, 1.0).force_n > 1.5 * before);
    CHECK(seal->use(*trocar::Model::try_plausible()) == TROCAR_STATUS_OTHER_MODEL);

    trocar::Refusal why;
    CHECK(!model.try_tuned({-1.0}, &why) && why.status == TROCAR_STATUS_MODEL_INVALID);
    CHECK(why.text.find("half_width_m must be finite and above 0 m") != std::string::npos);
}

static void refusals() {
    trocar::Refusal why;
    CHECK(!trocar::Model::try_load("no-such-model.json", &why));
    CHECK(why.status == TROCAR_STATUS_MODEL_UNREADABLE && why.text.find("no-such-model.json") != std::string::npos);
    CHECK(!trocar::Model::try_parse("{}", &why) && why.text.find("trocar-model") != std::string::npos);
    CHECK(!trocar::Model::try_parse({}, &why) && why.status == TROCAR_STATUS_MODEL_INVALID);
#if TROCAR_HAS_EXCEPTIONS
    try {
        trocar::Model::load("no-such-model.json");
        CHECK(false);
    } catch (const trocar::Error &error) {
        CHECK(error.status() == TROCAR_STATUS_MODEL_UNREADABLE);
    }
    try {
        trocar::State(trocar::Model::plausible(), std::nan(""));
        CHECK(false);
    } catch (const trocar::Error &error) {
        CHECK(error.status() == TROCAR_STATUS_NOT_FINITE);
    }
#endif
}

static_assert(noexcept(std::declval<trocar::Compensator &>().step(0.0, 0.0, 0.0)));
static_assert(noexcept(std::declval<trocar::Compensator &>().reset()));
static_assert(noexcept(std::declval<const trocar::Compensator &>().drift()));
static_assert(std::is_nothrow_move_constructible_v<trocar::Compensator>);
static_assert(!std::is_copy_constructible_v<trocar::Compensator>);

static void compensators(const trocar::Model &model) {
    trocar::Refusal why;
    CHECK(!trocar::Compensator::try_make(model, {}, &why) && why.status == TROCAR_STATUS_UNSUPPORTED);
    CHECK(why.text.find("set force_error_n") != std::string::npos);
    trocar::CompensatorOptions options;
    options.force_error_n = std::nan("");
    CHECK(!trocar::Compensator::try_make(model, options, &why) && why.status == TROCAR_STATUS_OUT_OF_RANGE);
    options.force_error_n = -1.0;
    CHECK(!trocar::Compensator::try_make(model, options, &why) && why.status == TROCAR_STATUS_OUT_OF_RANGE);
    CHECK(why.text.find("force_error_n must be above 0") != std::string::npos);

    // A tuned model compensates with its own friction: twice the force leaves nothing for the tissue.
    std::vector<double> values;
    for (const trocar::Tunable &tunable : model.tunables()) {
        values.push_back(tunable.name.find("force_n") != std::string::npos ? 2.0 * tunable.value : tunable.value);
    }
    options.force_error_n = 0.05;
    options.offset_n = 0.5;
    auto plain = trocar::Compensator::try_make(model, options);
    auto tuned = trocar::Compensator::try_make(*model.try_tuned(values), options);
    auto seal = trocar::State::try_at(*model.try_tuned(values), 0.0);
    trocar::Estimate last;
    for (int k = 0; k < 1000; ++k) {
        const double reading_n = 0.5 + (k == 0 ? 0.0 : seal->step_to(5e-5 * k, 1e-3).force_n);
        last = tuned->step(5e-5 * k, reading_n, 1e-3);
        CHECK(last && last.fault == TROCAR_FAULT_NONE);
        CHECK(plain->step(5e-5 * k, reading_n, 1e-3));
    }
    // To the rounding of a sum.
    CHECK(std::abs(last.tissue_force_n) < 1e-9 && std::abs(last.trocar_force_n - seal->force_n()) < 1e-9);
    CHECK(plain->step(0.05, 0.5 + last.trocar_force_n, 1e-3).tissue_force_n > 0.3 * last.trocar_force_n);

    const trocar::Estimate missing = tuned->step(0.05, std::nan(""), 1e-3);
    CHECK(missing && missing.fault == TROCAR_FAULT_NO_READING && std::isnan(missing.tissue_force_n));
    CHECK(std::string(trocar::fault_message(missing.fault)).find("no force reading") == 0);
    CHECK(tuned->drift().level == 1.0 && tuned->reset() == TROCAR_STATUS_OK);

    // What was moved from says so.
    trocar::Compensator moved = *std::move(tuned);
    CHECK(moved.step(0.0, 0.5, 0.0));
    const trocar::Estimate refused = tuned->step(0.0, 0.5, 0.0);
    CHECK(!refused && refused.status == TROCAR_STATUS_NULL_POINTER && std::isnan(refused.tissue_force_n));
#if TROCAR_HAS_EXCEPTIONS
    try {
        trocar::Compensator(trocar::Model::plausible());
        CHECK(false);
    } catch (const trocar::Error &error) {
        CHECK(error.status() == TROCAR_STATUS_UNSUPPORTED);
    }
#endif
}

// A state keeps its model, whoever else lets go of it, also in another thread.
static void owners(const char *path) {
    double here = 0.0;
    double there = 0.0;
    const auto run = [](trocar::State seal, double *force) { *force = seal.step(0.01, 0.1).force_n; };
    {
        auto model = trocar::Model::try_load(path);
        auto seal = trocar::State::try_at(*model, 0.0);
        model.reset();
        std::thread thread(run, *seal, &there);
        run(*seal, &here);
        thread.join();
    }
    CHECK(here == there && here > 0.0);
}

// What was moved from is empty and says so.
static void moved(trocar::Model model) {
    auto seal = trocar::State::try_at(model, 0.1);
    const trocar::State kept_seal = *std::move(seal);
    const trocar::Model kept = std::move(model);
    CHECK(kept.kind() == "ems" && model.kind().empty() && model.get() == nullptr && model.tunables().empty());
    trocar::Refusal why;
    CHECK(!model.try_tuned({1.0}, &why) && why.status == TROCAR_STATUS_NULL_POINTER);
    CHECK(!trocar::State::try_at(model, 0.1) && !trocar::Compensator::try_make(model));
    CHECK(kept_seal.model().kind() == "ems" && seal->model().kind().empty());
    CHECK(seal->step(1e-5, 1e-3).status == TROCAR_STATUS_NULL_POINTER && seal->use(model) == TROCAR_STATUS_NULL_POINTER);
    CHECK(!seal->mode() && !seal->deflection_m() && seal->rest(0.1) == TROCAR_STATUS_NULL_POINTER);
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    CHECK(trocar::fits_library());
    const auto model = trocar::Model::try_load(argv[1]);
    CHECK(model && model->kind() == "ems");
    if (model) {
        steps(*model);
        tuning(*model);
        compensators(*model);
        owners(argv[1]);
        moved(*model);
    }
    refusals();
    return failed;
}
