//! What importers do wrong, through the exported functions: an error, a message, nothing changed,
//! never a crash.
#![allow(unsafe_code)]
#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "all handles are live, all pointers valid or null"
)]

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::fs;
use std::path::Path;
use std::ptr::{null, null_mut};

use trocar_fmu::fmi::*;
use trocar_fmu::fmi2::*;
use trocar_fmu::fmi3::*;
use trocar_fmu::{Input, Logger2, token};
use trocar_model::{Element, ElementParams, MaxwellSlip, Rotation, SlipElement, Trocar};

const OK: c_int = 0;
const WARNING: c_int = 1;
const ERROR: c_int = 3;
const INPUT: u32 = 1;
const FORCE: u32 = 2;
const DEFLECTION: u32 = 3;
const MODE: u32 = 4;
const INITIAL_FORCE: u32 = 6;
const INITIAL_DEFLECTION: u32 = 7;
const TURN: u32 = 9;
const TORQUE: u32 = 10;
/// c of the element.
const HALF_WIDTH: u32 = 100;
/// v_c and T: a lag needs creep.
const CREEP: u32 = 110;
const LAG: u32 = 111;

thread_local! {
    static TOLD: RefCell<Vec<String>> = const { RefCell::new(Vec::new()) };
}

fn tell(text: *const c_char) {
    // SAFETY: the library tells with C strings.
    let text = unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned();
    TOLD.with_borrow_mut(|told| told.push(text));
}

/// What was told since the last call.
fn told() -> String {
    TOLD.take().join("\n")
}

unsafe extern "C" fn log_2(
    _: *mut c_void,
    _: *const c_char,
    _: c_int,
    _: *const c_char,
    text: *const c_char,
) {
    tell(text);
}

unsafe extern "C" fn log_3(_: *mut c_void, _: c_int, _: *const c_char, text: *const c_char) {
    tell(text);
}

fn callbacks() -> Callbacks {
    // SAFETY: named arguments are passed alike with and without further ones on the platforms these
    // tests run on.
    let logger: Logger2 = unsafe { std::mem::transmute(log_2 as *const ()) };
    let none = null();
    Callbacks {
        logger: Some(logger),
        allocate_memory: none,
        free_memory: none,
        step_finished: none,
        environment: null_mut(),
    }
}

/// A folder of resources with its tokens.
struct Model {
    folder: tempfile::TempDir,
    tokens: [CString; 2],
}

impl Model {
    fn new(trocar: Trocar) -> Self {
        let mut row = vec![0.0; trocar.count_numbers()];
        trocar.write_numbers(&mut row).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let bytes: Vec<u8> = row.iter().flat_map(|number| number.to_le_bytes()).collect();
        fs::write(folder.path().join("model.f64"), bytes).unwrap();
        Self { folder, tokens: Input::ALL.map(|input| CString::new(token(&row, input)).unwrap()) }
    }

    fn ems() -> Self {
        Self::new(Trocar::of_seal(
            Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap(),
        ))
    }

    fn uri(&self) -> CString {
        CString::new(format!("file://{}", self.folder.path().display())).unwrap()
    }

    fn path(&self) -> CString {
        CString::new(self.folder.path().to_str().unwrap()).unwrap()
    }

    fn fmi2(&self, guid: &CStr, uri: &CStr) -> *mut c_void {
        unsafe {
            fmi2Instantiate(c"seal".as_ptr(), 1, guid.as_ptr(), uri.as_ptr(), &callbacks(), 0, 0)
        }
    }

    fn fmi3(&self, token: &CStr, path: &CStr) -> *mut c_void {
        let (name, token, path) = (c"seal".as_ptr(), token.as_ptr(), path.as_ptr());
        unsafe {
            fmi3InstantiateCoSimulation(
                name,
                token,
                path,
                0,
                0,
                0,
                0,
                null(),
                0,
                null_mut(),
                Some(log_3),
                null(),
            )
        }
    }

    /// Driven by position.
    fn instance(&self) -> Unit {
        self.driven_by(Input::Position)
    }

    fn driven_by(&self, input: Input) -> Unit {
        let token = &self.tokens[usize::from(input == Input::Velocity)];
        let handle = self.fmi2(token, &self.uri());
        assert!(!handle.is_null(), "{}", told());
        Unit(handle)
    }
}

/// An instance of FMI 2.0, freed at the end.
struct Unit(*mut c_void);

impl Drop for Unit {
    fn drop(&mut self) {
        unsafe { fmi2FreeInstance(self.0) }
    }
}

impl Unit {
    fn started(model: &Model) -> Self {
        let unit = model.instance();
        assert_eq!([unit.enter(), unit.exit()], [OK; 2]);
        unit
    }

    fn enter(&self) -> c_int {
        unsafe { fmi2EnterInitializationMode(self.0) }
    }

    fn exit(&self) -> c_int {
        unsafe { fmi2ExitInitializationMode(self.0) }
    }

    fn step(&self, point: f64, size: f64) -> c_int {
        unsafe { fmi2DoStep(self.0, point, size, 1) }
    }

    fn set(&self, pairs: &[(u32, f64)]) -> c_int {
        let (references, values): (Vec<u32>, Vec<f64>) = pairs.iter().copied().unzip();
        unsafe { fmi2SetReal(self.0, references.as_ptr(), references.len(), values.as_ptr()) }
    }

    fn get(&self, reference: u32) -> Result<f64, c_int> {
        let mut value = f64::NAN;
        match unsafe { fmi2GetReal(self.0, &reference, 1, &mut value) } {
            OK => Ok(value),
            status => Err(status),
        }
    }

    fn state(&self) -> *mut c_void {
        let mut state = null_mut();
        assert_eq!(unsafe { fmi2GetFMUstate(self.0, &mut state) }, OK);
        state
    }

    fn bytes(&self, state: *mut c_void) -> Vec<u8> {
        let mut size = 0;
        assert_eq!(unsafe { fmi2SerializedFMUstateSize(self.0, state, &mut size) }, OK);
        let mut bytes = vec![0; size];
        assert_eq!(unsafe { fmi2SerializeFMUstate(self.0, state, bytes.as_mut_ptr(), size) }, OK);
        bytes
    }

    fn read(&self, bytes: &[u8]) -> (c_int, *mut c_void) {
        let mut state = null_mut();
        (unsafe { fmi2DeSerializeFMUstate(self.0, bytes.as_ptr(), bytes.len(), &mut state) }, state)
    }

    fn free(&self, mut state: *mut c_void) {
        assert_eq!(unsafe { fmi2FreeFMUstate(self.0, &mut state) }, OK);
        assert!(state.is_null());
    }
}

#[test]
fn instantiation_refuses_and_says_why() {
    let model = Model::ems();
    let uri = |path: &Path| CString::new(format!("file://{}", path.display())).unwrap();
    let missing = uri(&model.folder.path().join("missing"));
    for (guid, uri, words) in [
        (c"{wrong}", &model.uri(), "{wrong} is not that of the model in the resources"),
        (&model.tokens[0], &missing, "cannot read the model"),
        (&model.tokens[0], &CString::from(c"http://example/resources"), "must be a file: URI"),
    ] {
        assert!(model.fmi2(guid, uri).is_null());
        let told = told();
        assert!(told.starts_with("fmi2Instantiate: ") && told.contains(words), "{told}");
    }
    assert!(model.fmi3(c"{wrong}", &model.path()).is_null());
    assert!(told().contains("{wrong} is not that of the model"));
    assert!(model.fmi3(&model.tokens[1], c"/nowhere").is_null());
    assert!(told().contains("cannot read the model /nowhere/model.f64"));
    assert!(model.fmi3(c"\xff", &model.path()).is_null());
    assert!(told().contains("the token is not UTF-8"));

    let (name, guid, uri) = (c"seal".as_ptr(), model.tokens[0].as_ptr(), model.uri());
    let (no, calls) = (null(), callbacks());
    unsafe {
        for (name, guid, uri, words) in [
            (no, guid, uri.as_ptr(), "null pointer for the instance name"),
            (name, no, uri.as_ptr(), "null pointer for the GUID"),
            (name, guid, no, "null pointer for the resources"),
        ] {
            assert!(fmi2Instantiate(name, 1, guid, uri, &calls, 0, 0).is_null());
            assert!(told().contains(words), "{words}");
        }
        assert!(fmi2Instantiate(name, 0, guid, uri.as_ptr(), &calls, 0, 0).is_null());
        assert!(told().contains("co-simulation only"));
        assert!(fmi2Instantiate(name, 1, guid, uri.as_ptr(), null(), 0, 0).is_null());
        let path = model.path();
        let (event_mode, early) = (1, 0);
        assert!(
            fmi3InstantiateCoSimulation(
                name,
                guid,
                path.as_ptr(),
                0,
                0,
                event_mode,
                early,
                null(),
                0,
                null_mut(),
                Some(log_3),
                null()
            )
            .is_null()
        );
        assert!(told().contains("no event mode"));
        assert!(
            fmi3InstantiateModelExchange(name, guid, path.as_ptr(), 0, 0, null_mut(), Some(log_3))
                .is_null()
        );
        assert!(told().contains("co-simulation only"));
        // Without a logger nobody is told, and nothing happens.
        assert!(
            fmi3InstantiateModelExchange(name, guid, path.as_ptr(), 0, 0, null_mut(), None)
                .is_null()
        );
    }
}

#[test]
fn damaged_models_are_refused() {
    let model = Model::ems();
    let path = model.folder.path().join("model.f64");
    let whole = fs::read(&path).unwrap();
    for damaged in [&whole[..0], &whole[..7], &whole[..whole.len() - 8], &whole[..whole.len() - 1]]
    {
        fs::write(&path, damaged).unwrap();
        assert!(model.fmi2(&model.tokens[0], &model.uri()).is_null());
        assert!(told().contains("damaged"));
    }
    // One number after the other turned: another model, which the token does not fit, or none.
    for place in (0..whole.len()).step_by(8) {
        for value in [f64::NAN, -1.0, 1e300, f64::INFINITY] {
            let mut bytes = whole.clone();
            bytes[place..place + 8].copy_from_slice(&value.to_le_bytes());
            fs::write(&path, bytes).unwrap();
            assert!(
                model.fmi3(&model.tokens[0], &model.path()).is_null()
                    || value == f64_at(&whole, place)
            );
            told();
        }
    }
}

fn f64_at(bytes: &[u8], place: usize) -> f64 {
    f64::from_le_bytes(bytes[place..place + 8].try_into().unwrap())
}

#[test]
fn null_pointers_are_refused() {
    let model = Model::ems();
    let unit = Unit::started(&model);
    let c = unit.0;
    let state = unit.state();
    let mut flag = false;
    unsafe {
        // Without an instance there is no logger to report it to.
        assert_eq!(fmi2DoStep(null_mut(), 0.0, 1e-3, 1), ERROR);
        assert_eq!(fmi3Terminate(null_mut()), ERROR);
        fmi2FreeInstance(null_mut());
        fmi3FreeInstance(null_mut());
        assert_eq!(told(), "");
        let statuses = [
            fmi2GetReal(c, null(), 1, &mut 0.0),
            fmi2GetReal(c, &FORCE, 1, null_mut()),
            fmi2SetReal(c, &INPUT, 1, null()),
            fmi2GetInteger(c, &MODE, 1, null_mut()),
            fmi2GetString(c, null(), 1, null_mut()),
            fmi2GetFMUstate(c, null_mut()),
            fmi2SetFMUstate(c, null_mut()),
            fmi2SerializedFMUstateSize(c, null_mut(), &mut 0),
            fmi2SerializedFMUstateSize(c, state, null_mut()),
            fmi2SerializeFMUstate(c, state, null_mut(), 1 << 20),
            fmi2DeSerializeFMUstate(c, null(), 8, &mut null_mut()),
            fmi2GetRealStatus(c, 2, null_mut()),
            fmi2SetDebugLogging(c, 1, 1, null()),
            fmi3DoStep(c, 0.0, 1e-3, 0, &mut flag, &mut flag, null_mut(), &mut 0.0),
            fmi3GetFloat64(c, &FORCE, 1, null_mut(), 1),
        ];
        assert_eq!(statuses, [ERROR; 15]);
        let told_each = TOLD.take();
        assert_eq!(told_each.len(), statuses.len());
        assert!(told_each.iter().all(|text| text.contains(": null pointer for ")), "{told_each:?}");
        assert_eq!(fmi3GetFloat64(c, &FORCE, 1, [0.0; 2].as_mut_ptr(), 2), ERROR);
        assert!(told().contains("1 value references need as many values, got 2"));
        // Nothing asked for, nothing wrong.
        assert_eq!(fmi2GetReal(c, null(), 0, null_mut()), OK);
        assert_eq!(fmi2SetString(c, null(), 0, null()), OK);
        assert_eq!(fmi2FreeFMUstate(c, null_mut()), OK);
        assert_eq!(fmi2FreeFMUstate(c, &mut null_mut()), OK);
    }
    assert_eq!(told(), "");
    unit.free(state);
}

#[test]
fn calls_in_the_wrong_phase_are_refused() {
    let model = Model::ems();
    let unit = model.instance();
    let refused = |status: c_int, words: &str| {
        let told = told();
        assert!(status == ERROR && told.contains(words), "{status} {told}");
    };
    refused(unit.step(0.0, 1e-3), "not yet in initialization mode");
    refused(unit.exit(), "not yet in initialization mode");
    unsafe {
        refused(fmi2Terminate(unit.0), "not yet in initialization mode");
        assert_eq!(unit.enter(), OK);
        refused(unit.enter(), "in initialization mode");
        refused(fmi2SetupExperiment(unit.0, 0, 0.0, 0.0, 0, 0.0), "in initialization mode");
        refused(unit.step(0.0, 1e-3), "in initialization mode");
        assert_eq!(unit.exit(), OK);
        refused(unit.exit(), "stepping");
        refused(fmi3EnterInitializationMode(unit.0, 0, 0.0, 0.0, 0, 0.0), "stepping");
        refused(fmi3EnterEventMode(unit.0), "no event mode");
        refused(fmi3EnterConfigurationMode(unit.0), "no structural parameters");
        refused(fmi2CancelStep(unit.0), "no step is ever pending");
        assert_eq!(fmi2Terminate(unit.0), OK);
        refused(fmi2Terminate(unit.0), "terminated");
        refused(unit.step(0.0, 1e-3), "terminated");
        refused(unit.set(&[(INPUT, 0.1)]), "position_m cannot be set while the FMU is terminated");
        assert!(unit.get(FORCE).is_ok());
        assert_eq!(fmi2Reset(unit.0), OK);
        refused(fmi2SetupExperiment(unit.0, 0, 0.0, f64::NAN, 0, 0.0), "start time must be finite");
        refused(
            fmi2SetupExperiment(unit.0, 0, 0.0, 1.0, 1, 1.0),
            "stop time must be above the start time 1 s",
        );
        assert_eq!(fmi2SetupExperiment(unit.0, 0, 0.0, 1.0, 1, 1.5), OK);
    }
    assert_eq!([unit.enter(), unit.exit(), unit.step(1.0, 0.25)], [OK; 3]);
    refused(unit.step(1.25, 0.5), "beyond the stop time 1.5 s");
    refused(unit.step(1.0, 0.25), "communication point must be 1.25 s");
    assert_eq!(unit.step(1.25, 0.25), OK);
}

#[test]
fn wrong_variables_and_values_are_refused() {
    let model = Model::ems();
    let unit = Unit::started(&model);
    assert_eq!(unit.get(99), Err(ERROR));
    assert!(told().contains("no variable of type Real has value reference 99"));
    assert_eq!(unit.get(MODE), Err(ERROR));
    assert_eq!(unit.get(u32::MAX), Err(ERROR));
    told();
    unsafe {
        assert_eq!(fmi2GetInteger(unit.0, &FORCE, 1, &mut 0), ERROR);
        assert!(
            told().contains("no variable of type Integer or Enumeration has value reference 2")
        );
        assert_eq!(fmi2SetInteger(unit.0, &MODE, 1, &1), ERROR);
        assert!(told().contains("mode cannot be set"));
        assert_eq!(fmi2GetBoolean(unit.0, &FORCE, 1, &mut 0), ERROR);
        assert!(told().contains("no variable of type Boolean"));
        assert_eq!(fmi3SetFloat32(unit.0, &FORCE, 1, &1.0, 1), ERROR);
        assert!(told().contains("no variable of type Float32"));
        assert_eq!(fmi2SetDebugLogging(unit.0, 1, 1, [c"logAll".as_ptr()].as_ptr()), ERROR);
        assert!(told().contains("no log category \"logAll\""));
    }
    // One of several is wrong: none is set.
    let width = unit.get(HALF_WIDTH).unwrap();
    assert_eq!(unit.set(&[(INPUT, 0.2), (HALF_WIDTH, 2.0 * width), (FORCE, 1.0)]), ERROR);
    assert_eq!(unit.set(&[(HALF_WIDTH, 2.0 * width), (INPUT, f64::NAN)]), ERROR);
    assert_eq!(unit.set(&[(INPUT, 0.2), (HALF_WIDTH, 0.0)]), ERROR);
    assert!(told().contains("half_width_m must be above 0, got 0; the old value stays"));
    assert_eq!((unit.get(INPUT), unit.get(HALF_WIDTH)), (Ok(0.0), Ok(width)));
}

/// Parameters that hang together may come one by one, in any order; what does not go together in
/// the end is taken back.
#[test]
fn parameters_count_together() {
    let model = Model::ems();
    let unit = Unit::started(&model);
    assert_eq!(
        [unit.set(&[(LAG, 0.1)]), unit.set(&[(CREEP, 1e-4)]), unit.step(0.0, 1e-3)],
        [OK; 3]
    );
    assert_eq!(unit.set(&[(CREEP, 0.0)]), OK);
    assert_eq!(unit.step(1e-3, 1e-3), ERROR);
    assert!(told().contains("friction_lag_s = 0.1 s needs a creep_velocity_m_s above 0"));
    assert_eq!((unit.get(CREEP), unit.get(LAG)), (Ok(1e-4), Ok(0.1)));
    assert_eq!(unit.step(1e-3, 1e-3), OK);
}

#[test]
fn a_step_that_is_no_number_moves_nothing() {
    let model = Model::ems();
    let unit = Unit::started(&model);
    assert_eq!([unit.set(&[(INPUT, 1e-3)]), unit.step(0.0, 1e-3)], [OK; 2]);
    let before = (unit.get(FORCE), unit.get(DEFLECTION));
    assert_eq!([unit.set(&[(INPUT, 1e308)]), unit.step(1e-3, 1e-300)], [OK, ERROR]);
    assert!(told().contains("gives a displacement or velocity that is not finite"));
    assert_eq!((unit.get(FORCE), unit.get(DEFLECTION)), before);
    assert_eq!([unit.set(&[(INPUT, 2e-3)]), unit.step(1e-3, 1e-3)], [OK; 2]);
    assert_ne!(unit.get(FORCE), before.0);
}

#[test]
fn a_start_is_what_was_asked_for_or_is_remarked() {
    let model = Model::ems();
    let start = |pairs: &[(u32, f64)]| {
        let unit = model.instance();
        assert_eq!([unit.enter(), unit.set(pairs)], [OK; 2]);
        (unit.exit(), unit)
    };
    let (status, unit) = start(&[(INITIAL_FORCE, 0.5), (INPUT, 0.1)]);
    assert_eq!(status, OK);
    assert!((unit.get(FORCE).unwrap() - 0.5).abs() < 1e-6);
    let (status, unit) = start(&[(INITIAL_DEFLECTION, 1e-3)]);
    assert_eq!((status, unit.get(DEFLECTION)), (OK, Ok(1e-3)));
    let (status, unit) = start(&[(INITIAL_FORCE, 50.0)]);
    assert_eq!(status, WARNING);
    let force = unit.get(FORCE).unwrap();
    assert!(told().contains(&format!(
        "initial_force_n = 50 is more than the seal can hold, it begins with {force}"
    )));
    let (status, unit) = start(&[(INITIAL_FORCE, 0.5), (INITIAL_DEFLECTION, 1e-3)]);
    assert_eq!(status, ERROR);
    assert!(told().contains("at most one may differ from 0"));
    assert_eq!([unit.set(&[(INITIAL_FORCE, 0.0)]), unit.exit()], [OK; 2]);
}

#[test]
fn states_that_are_not_whole_or_not_ours_are_refused() {
    let model = Model::ems();
    let unit = Unit::started(&model);
    assert_eq!([unit.set(&[(INPUT, 1e-3)]), unit.step(0.0, 1e-3)], [OK; 2]);
    let state = unit.state();
    let bytes = unit.bytes(state);
    for length in 0..bytes.len() {
        assert_eq!(unit.read(&bytes[..length]), (ERROR, null_mut()), "{length} bytes");
        assert!(told().contains("bytes"));
    }
    for place in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[place] ^= 0x40;
        assert_eq!(unit.read(&damaged), (ERROR, null_mut()), "byte {place}");
        let told = told();
        assert!(told.contains("damaged") || told.contains("another model"), "{told}");
    }
    let bank = [SlipElement { stiffness: 400.0, limit_force: 1.0 }];
    let other = Model::new(Trocar::of_seal(trocar_model::Classical::MaxwellSlip(
        MaxwellSlip::new(&bank, 5.0).unwrap(),
    )));
    let foreign = other.instance();
    assert_eq!(foreign.read(&bytes), (ERROR, null_mut()));
    assert!(told().contains("another model"));
    unsafe {
        assert_eq!(fmi2SetFMUstate(foreign.0, state), ERROR);
        assert!(told().contains("another model"));
        let mut small = [0; 16];
        assert_eq!(fmi2SerializeFMUstate(unit.0, state, small.as_mut_ptr(), small.len()), ERROR);
        assert!(told().contains("bytes, got 16"));
    }
    let (status, copy) = unit.read(&bytes);
    assert_eq!(status, OK);
    assert_eq!(unit.bytes(copy), bytes);
    [state, copy].into_iter().for_each(|state| unit.free(state));
}

/// A model without a deflection has no such variables.
#[test]
fn a_classical_model_has_neither_deflection_nor_mode() {
    let bank = [SlipElement { stiffness: 400.0, limit_force: 1.0 }];
    let model = Model::new(Trocar::of_seal(trocar_model::Classical::MaxwellSlip(
        MaxwellSlip::new(&bank, 5.0).unwrap(),
    )));
    let unit = Unit::started(&model);
    assert_eq!([unit.get(DEFLECTION), unit.get(INITIAL_DEFLECTION)], [Err(ERROR); 2]);
    assert_eq!(unsafe { fmi2GetInteger(unit.0, &MODE, 1, &mut 0) }, ERROR);
    assert_eq!([unit.set(&[(INPUT, 1e-3)]), unit.step(0.0, 1.0)], [OK; 2]);
    assert!((unit.get(FORCE).unwrap() - (0.4 + 5.0 * 1e-3)).abs() < 1e-12);
}

/// Any values of the parameters, turned while it runs: forces stay finite, and states go round.
#[test]
fn turned_at_random_it_stays_finite() {
    let model = Model::ems();
    let unit = Unit::started(&model);
    let mut seed = 1u64;
    let mut random = || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    };
    let starts: Vec<f64> =
        (HALF_WIDTH..HALF_WIDTH + 14).map(|reference| unit.get(reference).unwrap()).collect();
    let (mut time, mut refused) = (0.0, 0);
    for k in 0..20_000 {
        if k % 10 == 0 {
            let place = (random() * 14.0) as usize;
            let value = starts[place] * 10f64.powf(2.0 * random() - 1.0) + 0.01 * random();
            unit.set(&[(HALF_WIDTH + place as u32, value)]);
        }
        assert_eq!(unit.set(&[(INPUT, 0.01 * random())]), OK);
        match unit.step(time, 1e-3) {
            OK => time += 1e-3,
            _ => refused += 1,
        }
        assert!(unit.get(FORCE).unwrap().is_finite() && unit.get(DEFLECTION).unwrap().abs() < 1.0);
        if k % 1000 == 0 {
            let state = unit.state();
            let bytes = unit.bytes(state);
            let (status, copy) = unit.read(&bytes);
            assert_eq!((status, unit.bytes(copy)), (OK, bytes), "{}", told());
            [state, copy].into_iter().for_each(|state| unit.free(state));
        }
    }
    assert!(refused < 10_000, "{refused} steps refused");
}

/// Instances in threads of their own are independent.
#[test]
fn threads() {
    let model = Model::ems();
    let run = |direction: f64| {
        let unit = Unit::started(&model);
        let mut forces = Vec::new();
        for k in 0..2000 {
            assert_eq!(unit.set(&[(INPUT, direction * 1e-5 * f64::from(k % 700))]), OK);
            assert_eq!(unit.step(f64::from(k) * 1e-3, 1e-3), OK);
            forces.push(unit.get(FORCE).unwrap());
        }
        forces
    };
    let alone = [run(1.0), run(-1.0)];
    let together = std::thread::scope(|scope| {
        let threads: Vec<_> =
            (0..8).map(|k| scope.spawn(move || run(if k % 2 == 0 { 1.0 } else { -1.0 }))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
    });
    for (k, forces) in together.iter().enumerate() {
        assert_eq!(*forces, alone[k % 2]);
    }
}

fn turning() -> Trocar {
    let rotation = Rotation {
        shaft_radius: 5e-3,
        circumferential_stiffness: 425.0,
        circumferential_ratio: 0.8,
    };
    Trocar::of_seal(Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap())
        .with_rotation(Some(rotation))
        .unwrap()
}

/// By position and angle, and by both velocities, with a state by bytes in the middle.
#[test]
fn force_and_torque_are_those_of_the_model() {
    let trocar = turning();
    let model = Model::new(trocar);
    for input in Input::ALL {
        let mut unit = model.driven_by(input);
        let start = if input == Input::Position { 0.3 } else { 0.0 };
        assert_eq!(unit.set(&[(TURN, start)]), OK);
        assert_eq!([unit.enter(), unit.exit()], [OK; 2]);
        let mut state = trocar.rest(0.0).with_angle(start);
        for k in 0..2000 {
            let time = 1e-3 * f64::from(k);
            let (speed, turn) = (0.03 * (7.0 * time).sin(), 8.0 * (5.0 * time).cos());
            let angle = state.turning().unwrap().angle() + turn * 1e-3;
            let inputs = match input {
                Input::Position => (state.position() + speed * 1e-3, angle),
                Input::Velocity => (speed, turn),
            };
            match input {
                Input::Position => trocar.turn_to(&mut state, inputs.0, angle, 1e-3),
                Input::Velocity => trocar.turn(&mut state, speed * 1e-3, angle, 1e-3),
            };
            assert_eq!(unit.set(&[(INPUT, inputs.0), (TURN, inputs.1)]), OK);
            assert_eq!(unit.step(time, 1e-3), OK, "{}", told());
            assert_eq!(
                [unit.get(FORCE), unit.get(TORQUE)],
                [state.force(), state.torque()].map(Ok)
            );
            if k == 1000 {
                let state = unit.state();
                let bytes = unit.bytes(state);
                unit.free(state);
                unit = model.driven_by(input);
                let (status, copy) = unit.read(&bytes);
                assert_eq!([status, unsafe { fmi2SetFMUstate(unit.0, copy) }], [OK; 2]);
                unit.free(copy);
            }
        }
        assert!(state.torque().abs() > 5e-3);
    }
}

#[test]
fn angles_that_are_none_are_refused() {
    let unit = Unit::started(&Model::new(turning()));
    assert_eq!(unit.set(&[(TURN, f64::NAN)]), ERROR);
    assert!(told().contains("angle_rad must be finite"));
    assert_eq!(unit.set(&[(TURN, f64::MAX)]), OK);
    let before = unit.get(TORQUE);
    assert_eq!(unit.step(0.0, 1e-3), ERROR);
    assert!(told().contains("finite"));
    assert_eq!([unit.get(TORQUE), unit.get(TURN)], [before, Ok(f64::MAX)]);
    assert_eq!(unit.set(&[(TORQUE, 1.0)]), ERROR);
    assert!(told().contains("torque_n_m cannot be set"));
    let plain = Unit::started(&Model::ems());
    assert_eq!([plain.set(&[(TURN, 1.0)]), plain.get(TORQUE).unwrap_err()], [ERROR; 2]);
}
