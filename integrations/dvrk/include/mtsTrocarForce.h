/*
 * cisstMultiTask component for the dVRK: the force on the tissue from a force sensor outside the body, as a force source for
 * teleoperation (psm_force_source). docs/reference/dvrk.md describes interfaces, configuration, signs and frames.
 */
#ifndef _mtsTrocarForce_h
#define _mtsTrocarForce_h

#include <optional>
#include <string>

#include <cisstMultiTask/mtsInterfaceProvided.h>
#include <cisstMultiTask/mtsInterfaceRequired.h>
#include <cisstMultiTask/mtsTaskPeriodic.h>
#include <cisstParameterTypes/prmForceCartesianGet.h>
#include <cisstParameterTypes/prmPositionCartesianGet.h>
#include <cisstParameterTypes/prmStateJoint.h>
#include <cisstVector/vctDynamicMatrixTypes.h>

#include <trocar_ros/parameters.hpp>
#include <trocar_ros/setup.hpp>
#include <trocar_ros/tissue_force.hpp>

/** Keys of the configuration: those that the ROS node has for the observer, and those of the component. */
struct mtsTrocarForceParameters : trocar_ros::Parameters {
    std::string joint = "insertion";
    double longest_age_s = 0.1;

    template <typename Visit> void each(Visit visit) {
        trocar_ros::Parameters::each(visit);
        visit("joint", joint, "Prismatic joint along the shaft, by its name in measured_js; its position is in m.",
              std::optional<trocar_ros::Range>());
        visit("longest_age_s", longest_age_s, "An older force is not valid, s.",
              std::optional<trocar_ros::Range>({1e-3, 60.0}));
    }
};

class mtsTrocarForce : public mtsTaskPeriodic {
    CMN_DECLARE_SERVICES(CMN_DYNAMIC_CREATION_ONEARG, CMN_LOG_ALLOW_DEFAULT);

  public:
    mtsTrocarForce(const std::string &componentName, const double periodInSeconds);
    explicit mtsTrocarForce(const mtsTaskPeriodicConstructorArg &arg);

    /** Reads a configuration (share/trocar-force.json). One that is refused is reported, and the last good one kept. */
    void Configure(const std::string &filename) override;
    void Startup(void) override {}
    void Run(void) override;
    void Cleanup(void) override {}

  private:
    void Init(void);
    void TakeSamples(void);
    void Publish(void);
    /** Direction of insertion in the orientation of measured_cp; nothing where it is not known, and why. */
    std::optional<vct3> Insertion(std::string &why);
    /** 1 where the position of the joint grows on insertion, otherwise -1. */
    double Sign(void) const { return m_setup.parameters().invert_position ? -1.0 : 1.0; }
    /** Sends a reason when it arises, not in every period. */
    void Report(const std::string &reason);

    trocar_ros::Setup<mtsTrocarForceParameters> m_setup;
    std::optional<trocar_ros::Sample> m_sample;
    std::size_t m_place = 0;
    std::string m_reason;

    mtsFunctionRead measured_js, measured_cp, body_jacobian, sensor_measured_cf;
    prmStateJoint m_measured_js;
    prmPositionCartesianGet m_measured_cp;
    prmForceCartesianGet m_sensor_measured_cf;
    vctDoubleMat m_body_jacobian;

    mtsInterfaceProvided *m_interface = nullptr;
    prmForceCartesianGet m_measured_cf;
    /** Variance of the force along the shaft, N²; infinite where the force is not valid. */
    double m_variance;
};

CMN_DECLARE_SERVICES_INSTANTIATION(mtsTrocarForce);

#endif // _mtsTrocarForce_h
