//! No closed cycle of any seal has negative work, whatever its model terms.

use crate::common::general_elements;
use proptest::prelude::*;
use trocar::analyze::RandomCycles;
use trocar_model::{DeformationForce, Element, Relaxation, RelaxationArm, Stages};

/// Cycles tried on each seal.
const CYCLES: u32 = 20;

/// Any optional model terms alone or together: branches, κ, β, σ, Stribeck friction with or without
/// a multivalued law, creep, relaxing arms.
fn elements() -> impl Strategy<Value = Element> {
    let some = |values: std::ops::Range<f64>| prop_oneof![Just(0.0), values];
    let arm = (some(10.0..2000.0), 0.01..10.0_f64)
        .prop_map(|(stiffness, time)| RelaxationArm { stiffness, time });
    (general_elements(), 1.0..4.0_f64, some(1e-6..1e-3), [arm.clone(), arm]).prop_map(
        |(element, kappa, creep, arms)| {
            let mut params = *element.params();
            let deformation = &params.deformation;
            let kappa = Some(kappa * deformation.yield_stiffness());
            params.deformation =
                DeformationForce::new(*deformation.insertion(), *deformation.withdrawal(), kappa)
                    .unwrap();
            params.creep_velocity = creep;
            params.relaxation = Relaxation { arms };
            Element::new(params).unwrap()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_cycle_gives_work(element in elements(), seed: u64) {
        let found = RandomCycles::search(&element.into(), CYCLES, seed);
        prop_assert!(found.holds, "{found:#?}");
    }

    #[test]
    fn no_cycle_gives_work_with_several_elements(elements in prop::collection::vec(elements(), 2..4), seed: u64) {
        let found = RandomCycles::search(&Stages::new(&elements).unwrap(), CYCLES / 2, seed);
        prop_assert!(found.holds, "{found:#?}");
    }
}
