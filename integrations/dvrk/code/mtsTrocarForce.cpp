#include <mtsTrocarForce.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <set>
#include <type_traits>

#include <json/json.h>

CMN_IMPLEMENT_SERVICES_DERIVED_ONEARG(mtsTrocarForce, mtsTaskPeriodic, mtsTaskPeriodicConstructorArg);

namespace {

/** How far the column of a prismatic joint may be from unit length; that of a revolute one is a lever arm, m. */
constexpr double kUnitTolerance = 1e-3;

/** Largest time that fits into 64 bits, ns. */
constexpr double kLargestTimeNs = 9.2e18;

/** None for a stamp that is no time: NaN, infinite, or centuries away. */
std::optional<std::int64_t> nanoseconds(double time_s) {
    if (!(std::abs(time_s * 1e9) < kLargestTimeNs)) {
        return std::nullopt;
    }
    return std::llround(time_s * 1e9);
}

/** Each takes the value of a key; where its type is another one, what it must be. */
const char *take(std::string &value, const Json::Value &given) {
    if (!given.isString()) {
        return "a string";
    }
    value = given.asString();
    return nullptr;
}

const char *take(bool &value, const Json::Value &given) {
    if (!given.isBool()) {
        return "true or false";
    }
    value = given.asBool();
    return nullptr;
}

const char *take(double &value, const Json::Value &given) {
    if (!given.isNumeric() || !std::isfinite(given.asDouble())) {
        return "a number";
    }
    value = given.asDouble();
    return nullptr;
}

/** Whether value is inside of range. */
template <typename Value> bool is_inside(const Value &value, const trocar_ros::Range &range) {
    if constexpr (std::is_same_v<Value, double>) {
        return value >= range.from && value <= range.to;
    }
    return true;
}

std::string text(const Json::Value &value) {
    Json::StreamWriterBuilder writer;
    writer["indentation"] = "";
    writer["precision"] = 6;
    return Json::writeString(writer, value);
}

/** Takes every key of the configuration; empty, or why it is refused. */
std::string refusal(const Json::Value &config, mtsTrocarForceParameters &parameters) {
    if (!config.isObject()) {
        return "must be a JSON object";
    }
    std::string why;
    std::set<std::string> unknown;
    for (const std::string &name : config.getMemberNames()) {
        unknown.insert(name);
    }
    std::string known;
    parameters.each([&](const char *name, auto &value, const char *, const std::optional<trocar_ros::Range> &range) {
        known += (known.empty() ? "" : ", ") + std::string(name);
        if (unknown.erase(name) == 0 || !why.empty()) {
            return;
        }
        const std::string got = std::string(", got ") + text(config[name]);
        if (const char *wanted = take(value, config[name])) {
            why = std::string(name) + " must be " + wanted + got;
        } else if (range && !is_inside(value, *range)) {
            why = std::string(name) + " must be from " + text(range->from) + " to " + text(range->to) + got;
        }
    });
    if (why.empty() && !unknown.empty()) {
        why = "unknown key \"" + *unknown.begin() + "\"; the keys are " + known;
    }
    return why;
}

} // namespace

mtsTrocarForce::mtsTrocarForce(const std::string &componentName, const double periodInSeconds)
    : mtsTaskPeriodic(componentName, periodInSeconds) {
    Init();
}

mtsTrocarForce::mtsTrocarForce(const mtsTaskPeriodicConstructorArg &arg) : mtsTaskPeriodic(arg) { Init(); }

void mtsTrocarForce::Init(void) {
    m_measured_cf.SetValid(false);
    // The state table would stamp the force with the time of the period, and an old one would look new.
    m_measured_cf.SetAutomaticTimestamp(false);
    m_variance = std::numeric_limits<double>::infinity();
    StateTable.AddData(m_measured_cf, "measured_cf");
    StateTable.AddData(m_variance, "variance");

    mtsInterfaceRequired *arm = AddInterfaceRequired("PSM");
    if (arm != nullptr) {
        arm->AddFunction("measured_js", measured_js);
        arm->AddFunction("measured_cp", measured_cp);
        arm->AddFunction("body/jacobian", body_jacobian);
    }
    mtsInterfaceRequired *sensor = AddInterfaceRequired("ForceSensor");
    if (sensor != nullptr) {
        sensor->AddFunction("measured_cf", sensor_measured_cf);
    }
    m_interface = AddInterfaceProvided("TissueForce");
    if (m_interface != nullptr) {
        m_interface->AddMessageEvents();
        m_interface->AddCommandReadState(StateTable, m_measured_cf, "measured_cf");
        m_interface->AddCommandReadState(StateTable, m_variance, "variance");
    }
}

void mtsTrocarForce::Configure(const std::string &filename) {
    std::ifstream file(filename);
    Json::Value config;
    Json::CharReaderBuilder reader;
    reader["rejectDupKeys"] = true;
    reader["failIfExtra"] = true;
    std::string errors;
    if (!file || !Json::parseFromStream(reader, file, &config, &errors)) {
        Report(filename + ": " + (file ? errors : "cannot be read"));
        return;
    }
    mtsTrocarForceParameters wanted;
    std::string why = refusal(config, wanted);
    if (!why.empty() || !m_setup.validate(wanted, true, why)) {
        Report(filename + ": " + why);
        return;
    }
    m_setup.apply();
    m_sample.reset();
    m_reason = "starting"; // so that the first estimate is reported
}

void mtsTrocarForce::Run(void) {
    ProcessQueuedCommands();
    ProcessQueuedEvents();
    if (m_setup.tissue() != nullptr) {
        TakeSamples();
    }
    Publish();
}

void mtsTrocarForce::TakeSamples(void) {
    // A state that was not renewed since the last period has the same stamp, and is not taken twice.
    if (measured_js(m_measured_js).IsOK() && m_measured_js.Valid()) {
        const auto &names = m_measured_js.Name();
        for (m_place = 0; m_place < names.size() && names[m_place] != m_setup.parameters().joint;) {
            ++m_place;
        }
        const auto stamp_ns = nanoseconds(m_measured_js.Timestamp());
        if (stamp_ns && m_place < m_measured_js.Position().size()) {
            m_setup.tissue()->add_position(*stamp_ns, Sign() * m_measured_js.Position()[m_place]);
        }
    }
    if (sensor_measured_cf(m_sensor_measured_cf).IsOK() && m_sensor_measured_cf.Valid()) {
        const auto &force = m_sensor_measured_cf.Force();
        if (const auto stamp_ns = nanoseconds(m_sensor_measured_cf.Timestamp())) {
            m_setup.tissue()->add_reading(*stamp_ns, m_setup.axis().of({force[0], force[1], force[2]}));
        }
    }
    while (const std::optional<trocar_ros::Sample> sample = m_setup.tissue()->next()) {
        m_sample = sample;
    }
}

void mtsTrocarForce::Publish(void) {
    for (std::size_t k = 0; k < 6; ++k) {
        m_measured_cf.Force()[k] = 0.0;
    }
    m_measured_cf.SetValid(false);
    m_variance = std::numeric_limits<double>::infinity();
    if (m_setup.tissue() == nullptr) {
        Report(m_reason.empty() ? "Configure() was not called" : m_reason);
        return;
    }
    const double now_s = StateTable.GetTic();
    if (!m_sample || now_s - static_cast<double>(m_sample->stamp_ns) / 1e9 > m_setup.parameters().longest_age_s) {
        Report("no new pair of measured_js (joint \"" + m_setup.parameters().joint + "\") and measured_cf of the sensor");
        return;
    }
    if (!std::isfinite(m_sample->tissue_force_n())) {
        Report(m_sample->estimate ? trocar::fault_message(m_sample->estimate.fault)
                                  : trocar::message(m_sample->estimate.status));
        return;
    }
    std::string why;
    const std::optional<vct3> insertion = Insertion(why);
    Report(why);
    if (!insertion) {
        return;
    }
    for (std::size_t k = 0; k < 3; ++k) {
        m_measured_cf.Force()[k] = m_sample->tissue_force_n() * (*insertion)[k];
    }
    m_variance = m_sample->variance_n2;
    m_measured_cf.SetTimestamp(static_cast<double>(m_sample->stamp_ns) / 1e9);
    m_measured_cf.SetValid(true);
}

std::optional<vct3> mtsTrocarForce::Insertion(std::string &why) {
    if (m_place >= m_measured_js.Name().size()) {
        why = "joint \"" + m_setup.parameters().joint + "\" is no longer in measured_js of the arm";
        return std::nullopt;
    }
    const bool is_read = measured_cp(m_measured_cp).IsOK() && body_jacobian(m_body_jacobian).IsOK();
    if (!is_read || !m_measured_cp.Valid() || m_place >= m_body_jacobian.cols() || m_body_jacobian.rows() < 3) {
        why = "measured_cp or body/jacobian of the arm is not valid";
        return std::nullopt;
    }
    // Linear velocity of the tip per velocity of the joint: for a prismatic joint its direction, in the frame of the tip.
    vct3 direction;
    double length = 0.0;
    for (std::size_t row = 0; row < 3; ++row) {
        direction[row] = 0.0;
        for (std::size_t column = 0; column < 3; ++column) {
            direction[row] +=
                Sign() * m_measured_cp.Position().Rotation().Element(row, column) * m_body_jacobian.Element(column, m_place);
        }
        length += direction[row] * direction[row];
    }
    if (!(std::abs(std::sqrt(length) - 1.0) < kUnitTolerance)) {
        why = "joint \"" + m_setup.parameters().joint + "\" is not prismatic: its column of body/jacobian has length " +
              std::to_string(std::sqrt(length));
        return std::nullopt;
    }
    return direction;
}

void mtsTrocarForce::Report(const std::string &reason) {
    if (reason == m_reason) {
        return;
    }
    m_reason = reason;
    if (m_interface == nullptr) {
        return;
    }
    if (reason.empty()) {
        m_interface->SendStatus(this->GetName() + ": tissue force is estimated");
    } else {
        m_interface->SendWarning(this->GetName() + ": no tissue force: " + reason);
    }
}
