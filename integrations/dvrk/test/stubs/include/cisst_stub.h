/*
 * Stub for tests, no cisst: see ../README.md. Interfaces as in cisst 1.2 to 1.4; each part names the header that it follows. What a
 * test needs beyond them stands under "For tests".
 */
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

/* cisstCommon/cmnClassRegisterMacros.h */
#define CMN_DYNAMIC_CREATION_ONEARG
#define CMN_LOG_ALLOW_DEFAULT
#define CMN_DECLARE_SERVICES(creation, log) static_assert(true)
#define CMN_DECLARE_SERVICES_INSTANTIATION(Class) static_assert(true)
#define CMN_IMPLEMENT_SERVICES_DERIVED_ONEARG(Class, Base, Arg)                                                       \
    static_assert(std::is_base_of_v<Base, Class> && std::is_constructible_v<Class, const Arg &>)

/* cisstCommon/cmnDataFunctionsMacros.h, cmnPortability.h: a member with its accessors. */
#define CISST_STUB_MEMBER(Type, Name)                                                                                 \
  public:                                                                                                             \
    void Get##Name(Type &placeholder) const { placeholder = Name##Member; }                                           \
    void Set##Name(const Type &newValue) { Name##Member = newValue; }                                                 \
    const Type &Name(void) const { return Name##Member; }                                                             \
    Type &Name(void) { return Name##Member; }                                                                         \
                                                                                                                      \
  protected:                                                                                                          \
    Type Name##Member

/* cisstVector/vctFixedSizeVectorTypes.h */
template <std::size_t Size> class vctFixedSizeVector {
  public:
    double &operator[](std::size_t index) { return elements_.at(index); }
    const double &operator[](std::size_t index) const { return elements_.at(index); }

  private:
    std::array<double, Size> elements_{};
};
using vct3 = vctFixedSizeVector<3>;
using vctDouble6 = vctFixedSizeVector<6>;

/* cisstVector/vctDynamicVectorTypes.h: no initialiser list, no push_back. */
template <typename Element> class vctDynamicVector {
  public:
    std::size_t size() const { return elements_.size(); }
    void SetSize(std::size_t size) { elements_.assign(size, Element()); }
    Element &operator[](std::size_t index) { return elements_.at(index); }
    const Element &operator[](std::size_t index) const { return elements_.at(index); }

  private:
    std::vector<Element> elements_;
};

/* cisstVector/vctDynamicMatrixTypes.h */
class vctDoubleMat {
  public:
    vctDoubleMat() = default;
    vctDoubleMat(std::size_t rows, std::size_t cols) : rows_(rows), cols_(cols), elements_(rows * cols) {}
    std::size_t rows() const { return rows_; }
    std::size_t cols() const { return cols_; }
    double &Element(std::size_t row, std::size_t col) { return elements_.at(row * cols_ + col); }
    const double &Element(std::size_t row, std::size_t col) const { return elements_.at(row * cols_ + col); }

  private:
    std::size_t rows_ = 0;
    std::size_t cols_ = 0;
    std::vector<double> elements_;
};

/* cisstVector/vctTransformationTypes.h: rotation matrix and translation, no matrix of 4 by 4. */
class vctMatRot3 {
  public:
    double &Element(std::size_t row, std::size_t col) { return elements_.at(3 * row + col); }
    const double &Element(std::size_t row, std::size_t col) const { return elements_.at(3 * row + col); }

  private:
    std::array<double, 9> elements_{1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
};

class vctFrm3 {
  public:
    vctMatRot3 &Rotation() { return rotation_; }
    const vctMatRot3 &Rotation() const { return rotation_; }
    vct3 &Translation() { return translation_; }
    const vct3 &Translation() const { return translation_; }

  private:
    vctMatRot3 rotation_;
    vct3 translation_;
};

/* cisstMultiTask/mtsGenericObject.h: not valid, at time 0, stamped by the state table. */
class mtsGenericObject {
  public:
    virtual ~mtsGenericObject() = default;

    bool SetTimestampIfAutomatic(double timestamp) {
        if (AutomaticTimestampMember) {
            TimestampMember = timestamp;
        }
        return AutomaticTimestampMember;
    }

    CISST_STUB_MEMBER(double, Timestamp) = 0.0;
    CISST_STUB_MEMBER(bool, AutomaticTimestamp) = true;
    CISST_STUB_MEMBER(bool, Valid) = false;
};

/* cisstParameterTypes/prmForceCartesianGet.h */
class prmForceCartesianGet : public mtsGenericObject {
    CISST_STUB_MEMBER(vctDouble6, Force);
    CISST_STUB_MEMBER(std::string, ReferenceFrame);
    CISST_STUB_MEMBER(std::string, MovingFrame);
};

/* cisstParameterTypes/prmPositionCartesianGet.cdg */
class prmPositionCartesianGet : public mtsGenericObject {
    CISST_STUB_MEMBER(std::string, MovingFrame);
    CISST_STUB_MEMBER(std::string, ReferenceFrame);
    CISST_STUB_MEMBER(vctFrm3, Position);
};

/* cisstParameterTypes/prmStateJoint.cdg */
class prmStateJoint : public mtsGenericObject {
    CISST_STUB_MEMBER(vctDynamicVector<std::string>, Name);
    CISST_STUB_MEMBER(vctDynamicVector<double>, Position);
    CISST_STUB_MEMBER(vctDynamicVector<double>, Velocity);
    CISST_STUB_MEMBER(vctDynamicVector<double>, Effort);
};

/* cisstMultiTask/mtsExecutionResult.h */
class mtsExecutionResult {
  public:
    explicit mtsExecutionResult(bool ok) : ok_(ok) {}
    bool IsOK() const { return ok_; }

  private:
    bool ok_;
};

/* cisstMultiTask/mtsFunctionRead.h; not connected where source is nothing. */
class mtsFunctionRead {
  public:
    template <typename Value> mtsExecutionResult operator()(Value &value) const {
        if (source == nullptr) {
            return mtsExecutionResult(false);
        }
        value = *static_cast<const Value *>(source);
        return mtsExecutionResult(true);
    }
    /* For tests: what it reads. */
    const void *source = nullptr;
};

/* cisstMultiTask/mtsInterfaceRequired.h */
class mtsInterfaceRequired {
  public:
    bool AddFunction(const std::string &name, mtsFunctionRead &function) { return functions.emplace(name, &function).second; }
    /* For tests. */
    std::map<std::string, mtsFunctionRead *> functions;
};

/*
 * cisstMultiTask/mtsStateTable.h, code/mtsStateTable.cpp: Advance() stamps every element with Tic, unless the element has automatic
 * timestamps switched off, and copies it to the row that readers get.
 */
class mtsStateTable {
  public:
    template <typename Value> void AddData(Value &element, const std::string &name = "") {
        const auto row = std::make_shared<Value>(element);
        elements_.push_back({name, &element, row, [this, row, &element] {
                                 if constexpr (std::is_base_of_v<mtsGenericObject, Value>) {
                                     element.SetTimestampIfAutomatic(tic_);
                                 }
                                 *row = element;
                             }});
    }
    double GetTic() const { return tic_; }
    void Advance() {
        for (const Element &element : elements_) {
            element.write();
        }
    }

    /* For tests: Start() at a time that they choose, and the row of an element. */
    void start(double now_s) { tic_ = now_s; }
    const void *row(const void *of) const {
        for (const Element &element : elements_) {
            if (element.data == of) {
                return element.row.get();
            }
        }
        return nullptr;
    }

  private:
    struct Element {
        std::string name;
        const void *data;
        std::shared_ptr<void> row;
        std::function<void()> write;
    };
    std::vector<Element> elements_;
    double tic_ = 0.0;
};

/* cisstMultiTask/mtsInterfaceProvided.h */
class mtsInterfaceProvided {
  public:
    void AddMessageEvents() {}
    template <typename Value>
    bool AddCommandReadState(const mtsStateTable &table, const Value &element, const std::string &name) {
        return commands.emplace(name, table.row(&element)).second;
    }
    void SendStatus(const std::string &text) { messages.push_back("status: " + text); }
    void SendWarning(const std::string &text) { messages.push_back("warning: " + text); }
    /* For tests: what a command reads, and what was sent. */
    std::map<std::string, const void *> commands;
    std::vector<std::string> messages;
};

/* cisstMultiTask/mtsTaskPeriodic.h */
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

    /* For tests: what a period does (mtsTask::DoRunInternal), and the interfaces. */
    void period(double now_s) {
        StateTable.start(now_s);
        Run();
        StateTable.Advance();
    }
    std::map<std::string, mtsInterfaceRequired> required;
    std::map<std::string, mtsInterfaceProvided> provided;

  protected:
    void ProcessQueuedCommands() {}
    void ProcessQueuedEvents() {}
    mtsStateTable StateTable;

  private:
    std::string name_;
};
