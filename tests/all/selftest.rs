//! The self-test's families, as `vpm-vdb selftest` makes them.

use vpm_vdb::selftest::{Effort, FAMILIES, run_family};

/// Prints a family's checks and asks that all pass.
fn all_pass(family: &str, effort: Effort) {
    let checks = run_family(family, effort).expect("the checks can be made");
    assert!(!checks.is_empty(), "no family {family}");
    for c in &checks {
        println!("{c}");
    }
    let failed: Vec<_> = checks.iter().filter(|c| !c.passed).collect();
    assert!(failed.is_empty(), "{family}: {failed:#?}");
}

macro_rules! families {
    ($($test:ident $name:literal;)*) => {
        $(
            #[test]
            fn $test() {
                all_pass($name, Effort::Quick);
            }
        )*
        /// The same with all points, rays and samples: an hour together, furnaces most of it.
        mod exhaustive {
            use super::{Effort, all_pass};

            $(
                #[test]
                #[ignore = "with all its points, rays and samples: minutes"]
                fn $test() {
                    all_pass($name, Effort::Exhaustive);
                }
            )*
        }

        /// Every family is one of the tests above.
        #[test]
        fn no_family_is_left_out() {
            assert_eq!(FAMILIES.map(|(name, _)| name), [$($name),*]);
        }
    };
}

families! {
    furnace "furnace";
    thickness "thickness";
    place "place";
    rays "rays";
    majorants "majorants";
    photons "photons";
    phase "phase";
    grids "grids";
    lights "lights";
    energy "energy";
    equivalence "equivalence";
    long "long";
}
