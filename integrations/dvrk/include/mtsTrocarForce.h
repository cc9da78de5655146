/*
 * cisstMultiTask component for the dVRK: the force on the tissue from a force sensor outside the body, as a force source for
 * teleoperation (psm_force_source). docs/dvrk.md describes interfaces, configuration, signs and frames.
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

#include <trocar_ros/axis.hpp>
#include <trocar_ros/tissue_force.hpp>

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
    /** Sends a reason when it arises, not in every period. */
    void Report(const std::string &reason);

    std::optional<trocar_ros::TissueForce> m_tissue;
    std::optional<trocar_ros::Sample> m_sample;
    trocar_ros::Axis m_axis;
    std::string m_joint = "insertion";
    std::size_t m_place = 0;
    double m_longest_age = 0.1;
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
