/* Stub for tests, no cisst: see ../README.md. */
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#define CMN_DYNAMIC_CREATION_ONEARG
#define CMN_LOG_ALLOW_DEFAULT
#define CMN_DECLARE_SERVICES(creation, log) static_assert(true)
#define CMN_DECLARE_SERVICES_INSTANTIATION(Class) static_assert(true)
#define CMN_IMPLEMENT_SERVICES_DERIVED_ONEARG(Class, Base, Arg)                                                       \
    static_assert(std::is_base_of_v<Base, Class> && std::is_constructible_v<Class, const Arg &>)

template <std::size_t Size> class vctFixedSizeVector {
  public:
    double &operator[](std::size_t place) { return elements_.at(place); }
    double operator[](std::size_t place) const { return elements_.at(place); }

  private:
    std::array<double, Size> elements_{};
};
using vct3 = vctFixedSizeVector<3>;
using vctDouble6 = vctFixedSizeVector<6>;

class vctDoubleMat {
  public:
    vctDoubleMat() = default;
    vctDoubleMat(std::size_t rows, std::size_t cols) : rows_(rows), cols_(cols), elements_(rows * cols) {}
    std::size_t rows() const { return rows_; }
    std::size_t cols() const { return cols_; }
    double &Element(std::size_t row, std::size_t col) { return elements_.at(row * cols_ + col); }
    double Element(std::size_t row, std::size_t col) const { return elements_.at(row * cols_ + col); }

  private:
    std::size_t rows_ = 0;
    std::size_t cols_ = 0;
    std::vector<double> elements_;
};

class vctFrm4x4 {
  public:
    vctDoubleMat &Rotation() { return rotation_; }
    const vctDoubleMat &Rotation() const { return rotation_; }

  private:
    vctDoubleMat rotation_{3, 3};
};

class mtsGenericObject {
  public:
    bool Valid() const { return valid_; }
    void SetValid(const bool &valid) { valid_ = valid; }
    double Timestamp() const { return timestamp_; }
    void SetTimestamp(const double &timestamp) { timestamp_ = timestamp; }

  private:
    bool valid_ = true;
    double timestamp_ = 0.0;
};

class prmForceCartesianGet : public mtsGenericObject {
  public:
    vctDouble6 &Force() { return force_; }
    const vctDouble6 &Force() const { return force_; }

  private:
    vctDouble6 force_;
};

class prmPositionCartesianGet : public mtsGenericObject {
  public:
    vctFrm4x4 &Position() { return position_; }
    const vctFrm4x4 &Position() const { return position_; }

  private:
    vctFrm4x4 position_;
};

class prmStateJoint : public mtsGenericObject {
  public:
    std::vector<std::string> &Name() { return name_; }
    std::vector<double> &Position() { return position_; }

  private:
    std::vector<std::string> name_;
    std::vector<double> position_;
};

class mtsExecutionResult {
  public:
    explicit mtsExecutionResult(bool ok) : ok_(ok) {}
    bool IsOK() const { return ok_; }

  private:
    bool ok_;
};

/** Reads what a test has put there; not connected where that is nothing. */
class mtsFunctionRead {
  public:
    template <typename Value> mtsExecutionResult operator()(Value &value) const {
        if (source == nullptr) {
            return mtsExecutionResult(false);
        }
        value = *static_cast<const Value *>(source);
        return mtsExecutionResult(true);
    }
    const void *source = nullptr;
};

class mtsInterfaceRequired {
  public:
    bool AddFunction(const std::string &name, mtsFunctionRead &function) { return functions.emplace(name, &function).second; }
    std::map<std::string, mtsFunctionRead *> functions;
};

class mtsStateTable {
  public:
    template <typename Value> void AddData(const Value &value, const std::string &name) { data[name] = &value; }
    double GetTic() const { return tic; }
    std::map<std::string, const void *> data;
    double tic = 0.0;
};

class mtsInterfaceProvided {
  public:
    void AddMessageEvents() {}
    template <typename Value> bool AddCommandReadState(const mtsStateTable &, const Value &value, const std::string &name) {
        return commands.emplace(name, &value).second;
    }
    void SendStatus(const std::string &text) { messages.push_back("status: " + text); }
    void SendWarning(const std::string &text) { messages.push_back("warning: " + text); }
    std::map<std::string, const void *> commands;
    std::vector<std::string> messages;
};

struct mtsTaskPeriodicConstructorArg {
    std::string Name;
    double Period = 0.0;
};

class mtsTaskPeriodic {
  public:
    mtsTaskPeriodic(const std::string &name, double) : name_(name) {}
    explicit mtsTaskPeriodic(const mtsTaskPeriodicConstructorArg &arg) : name_(arg.Name) {}
    virtual ~mtsTaskPeriodic() = default;
    virtual void Configure(const std::string &filename = "") = 0;
    virtual void Startup() = 0;
    virtual void Run() = 0;
    virtual void Cleanup() = 0;
    const std::string &GetName() const { return name_; }
    mtsInterfaceRequired *AddInterfaceRequired(const std::string &name) { return &required[name]; }
    mtsInterfaceProvided *AddInterfaceProvided(const std::string &name) { return &provided[name]; }

    std::map<std::string, mtsInterfaceRequired> required;
    std::map<std::string, mtsInterfaceProvided> provided;
    mtsStateTable StateTable;

  protected:
    void ProcessQueuedCommands() {}
    void ProcessQueuedEvents() {}

  private:
    std::string name_;
};
