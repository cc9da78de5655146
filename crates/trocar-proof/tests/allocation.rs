//! That no step of any model allocates, counted.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fs;
use std::hint::black_box;
use std::path::Path;

use trocar::model_file::ModelFile;
use trocar_model::Trocar;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counting what each thread asks for.
struct Counting;

fn count() {
    ALLOCATIONS.set(ALLOCATIONS.get() + 1);
}

// SAFETY: everything is passed on to the system's allocator as it came; counting touches a thread's
// own number, which needs no allocation and no destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promise, passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise, passed on.
        unsafe { System.dealloc(place, layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller's promise, passed on.
        unsafe { System.realloc(place, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(run: impl FnOnce()) -> usize {
    let before = ALLOCATIONS.get();
    run();
    ALLOCATIONS.get() - before
}

/// Rests, steps of all sizes and what is no step, by each way into the model.
fn drive(trocar: &Trocar<&[f64]>) {
    let mut state = trocar.rest(0.1);
    state = trocar.rest_at_force(state.position(), 0.5);
    for k in 0..20_000_u32 {
        let way = 1e-9 * f64::from(1 << (k % 27)) * if k.is_multiple_of(3) { -1.0 } else { 1.0 };
        let way = if k.is_multiple_of(101) { f64::NAN } else { way };
        let duration = [1e-3, 1e-9, 1.0, 0.0, f64::INFINITY][k as usize % 5];
        black_box(match k % 4 {
            0 => trocar.step_to(&mut state, way, duration),
            1 => trocar.step_velocity(&mut state, way, duration),
            _ => trocar.step(&mut state, way, duration),
        });
    }
    black_box((state.to_numbers(), state.deformation()));
}

#[test]
fn no_step_allocates() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../conformance/models");
    let mut models = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let model = ModelFile::read(&path).unwrap();
        let trocar = model.trocar.borrowed();
        assert_eq!(allocations(|| drive(&trocar)), 0, "{}", path.display());
        models += 1;
    }
    assert!(models >= 14, "{models}");
}

/// The counter counts: one box, and one vector that grows.
#[test]
fn what_allocates_is_counted() {
    assert_eq!(allocations(|| drop(black_box(Box::new(1)))), 1);
    let grown = allocations(|| {
        let mut vector = black_box(Vec::with_capacity(1));
        vector.extend(black_box([1, 2, 3]));
    });
    assert_eq!(grown, 2);
}
