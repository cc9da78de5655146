//! Programs that link only if a step of `trocar-model` cannot panic.
//!
//! Each runs one function beside a guard whose destructor calls a symbol that exists nowhere.
//! Leaving the function by a panic runs the destructor; leaving it otherwise does not. Where the
//! optimiser sees that nothing can panic, the call is gone and the program links; elsewhere the
//! linker misses `a_panic_is_possible`. The way of the crate `no-panic`, by hand. It needs
//! unwinding and one unit of code, so the profile `proof` of the workspace:
//!
//! ```text
//! cargo build -p trocar-proof --profile proof --features link --bin cannot_panic
//! ```
//!
//! `tests/panic.rs` builds all of them; `can_panic` and `can_overflow` must not link, or the proof
//! proves nothing.

use std::hint::black_box;

use trocar_model::{
    Classical, Element, ElementParams, MaxwellSlip, ParamError, PositionProfile, Seal, SlipElement,
    Trocar, TrocarState,
};

/// Calls `run`; with the feature `link` the program links only if `run` cannot panic.
#[inline(always)]
pub fn without_panic<T>(run: impl FnOnce() -> T) -> T {
    let guard = Guard;
    let result = run();
    std::mem::forget(guard);
    result
}

struct Guard;

impl Drop for Guard {
    #[inline(always)]
    fn drop(&mut self) {
        #[cfg(feature = "link")]
        {
            unsafe extern "C" {
                fn a_panic_is_possible() -> !;
            }
            // SAFETY: never runs: a program that holds this call does not link.
            unsafe { a_panic_is_possible() }
        }
    }
}

/// Runs `function` with a trocar and a state that the optimiser knows nothing of: neither the
/// model, nor its size.
///
/// # Errors
/// None: the models are made of constants.
pub fn run(
    function: impl Fn(&Trocar<&[f64]>, &mut TrocarState, f64, f64) -> f64,
) -> Result<(), ParamError> {
    let (offset, level) = ([0.0, 0.1], [1.0, 1.1]);
    let travel = PositionProfile::new(0.0, 0.2, black_box(&offset[..]), black_box(&level[..])).ok();
    let element = Element::new(ElementParams::plausible_10_5_mm()?)?;
    let slip = MaxwellSlip::new(&[SlipElement { stiffness: 1000.0, limit_force: 3.0 }], 1.0)?;
    for seal in [Seal::from(element), Seal::from(Classical::MaxwellSlip(slip))] {
        let trocar = black_box(Trocar::new(black_box(seal), black_box(travel)));
        let mut state = black_box(trocar.rest(0.1));
        black_box(function(
            black_box(&trocar),
            black_box(&mut state),
            black_box(1e-3),
            black_box(1e-3),
        ));
    }
    Ok(())
}
