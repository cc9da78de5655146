#include <mtsTrocarForce.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <utility>

#include <json/json.h>

CMN_IMPLEMENT_SERVICES_DERIVED_ONEARG(mtsTrocarForce, mtsTaskPeriodic, mtsTaskPeriodicConstructorArg);

namespace {

/** How far the column of a prismatic joint may be from unit length; that of a revolute one is a lever arm, m. */
constexpr double kUnitTolerance = 1e-3;

std::int64_t nanoseconds(double time_s) { return std::llround(time_s * 1e9); }

std::optional<double> number(const Json::Value &config, const char *name) {
    return config.isMember(name) ? std::optional<double>(config[name].asDouble()) : std::nullopt;
}

} // namespace

mtsTrocarForce::mtsTrocarForce(const std::string &componentName, const double periodInSeconds)
    : mtsTaskPeriodic(componentName, periodInSeconds) {
    Init();
}

mtsTrocarForce::mtsTrocarForce(const mtsTaskPeriodicConstructorArg &arg) : mtsTaskPeriodic(arg) { Init(); }

void mtsTrocarForce::Init(void) {
    m_measured_cf.SetValid(false);
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
    std::string errors;
    if (!file || !Json::parseFromStream(reader, file, &config, &errors)) {
        Report(filename + ": " + (file ? errors : "cannot be read"));
        return;
    }
    try {
        const std::string axis = config.get("force_axis", "z").asString();
        const std::optional<trocar_ros::Axis> parsed = trocar_ros::Axis::parse(axis);
        if (!parsed) {
            Report(filename + ": force_axis must be x, y, z, -x, -y or -z, got \"" + axis + "\"");
            return;
        }
        const std::string joint = config.get("joint", m_joint).asString();
        const double longest_age = config.get("longest_age_s", m_longest_age).asDouble();
        trocar_ros::Settings settings;
        settings.longest_interval_s = config.get("longest_interval_s", settings.longest_interval_s).asDouble();
        settings.compensator.adaptation = config.get("adaptation", true).asBool();
        settings.compensator.force_error_n = number(config, "force_error_n");
        settings.compensator.offset_n = number(config, "offset_n");
        settings.compensator.moving_mass_kg = number(config, "moving_mass_kg");
        settings.compensator.sensor_limit_n = number(config, "sensor_limit_n");
        trocar::Refusal why;
        std::optional<trocar_ros::TissueForce> made =
            trocar_ros::TissueForce::try_load(config.get("model", "").asString(), settings, &why);
        if (!made) {
            Report(filename + ": " + why.text);
            return;
        }
        m_tissue = std::move(made);
        m_sample.reset();
        m_axis = *parsed;
        m_joint = joint;
        m_longest_age = longest_age;
        m_reason = "starting"; // so that the first estimate is reported
    } catch (const Json::Exception &error) {
        Report(filename + ": " + error.what());
    }
}

void mtsTrocarForce::Run(void) {
    ProcessQueuedCommands();
    ProcessQueuedEvents();
    if (m_tissue) {
        TakeSamples();
    }
    Publish();
}

void mtsTrocarForce::TakeSamples(void) {
    // A state that was not renewed since the last period has the same stamp, and is not taken twice.
    if (measured_js(m_measured_js).IsOK() && m_measured_js.Valid()) {
        for (m_place = 0; m_place < m_measured_js.Name().size() && m_measured_js.Name()[m_place] != m_joint;) {
            ++m_place;
        }
        if (m_place < m_measured_js.Position().size()) {
            m_tissue->add_position(nanoseconds(m_measured_js.Timestamp()), m_measured_js.Position()[m_place]);
        }
    }
    if (sensor_measured_cf(m_sensor_measured_cf).IsOK() && m_sensor_measured_cf.Valid()) {
        const auto &force = m_sensor_measured_cf.Force();
        m_tissue->add_reading(nanoseconds(m_sensor_measured_cf.Timestamp()), m_axis.of({force[0], force[1], force[2]}));
    }
    while (const std::optional<trocar_ros::Sample> sample = m_tissue->next()) {
        m_sample = sample;
    }
}

void mtsTrocarForce::Publish(void) {
    for (std::size_t k = 0; k < 6; ++k) {
        m_measured_cf.Force()[k] = 0.0;
    }
    m_measured_cf.SetValid(false);
    m_variance = std::numeric_limits<double>::infinity();
    if (!m_tissue) {
        Report(m_reason.empty() ? "Configure() was not called" : m_reason);
        return;
    }
    const double now_s = StateTable.GetTic();
    if (!m_sample || now_s - static_cast<double>(m_sample->stamp_ns) / 1e9 > m_longest_age) {
        Report("no new pair of measured_js (joint \"" + m_joint + "\") and measured_cf of the sensor");
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
                m_measured_cp.Position().Rotation().Element(row, column) * m_body_jacobian.Element(column, m_place);
        }
        length += direction[row] * direction[row];
    }
    if (!(std::abs(std::sqrt(length) - 1.0) < kUnitTolerance)) {
        why = "joint \"" + m_joint + "\" is not prismatic: its column of body/jacobian has length " +
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
