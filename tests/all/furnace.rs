//! The furnace around volumes of files: the self-test's checks, on every density there is.

use vpm_vdb::grid::Grid;
use vpm_vdb::scene::Phase;
use vpm_vdb::selftest::furnace::{Beams, around, extinction_for, seen_by_paths};
use vpm_vdb::selftest::{Effort, Suite, Worst};

use crate::fields::real;

/// Densities of real volumes that are somewhere positive, and their names.
fn grids() -> Vec<(String, Grid)> {
    let mut grids = real();
    grids.retain(|(_, grid)| !grid.support().is_empty() && grid.range()[1] > 0.0);
    grids
}

/// Exactly 1 in every pixel: nothing is lost, nothing gained, nothing left to chance.
#[test]
fn paths_see_no_real_volume() {
    let phases = [
        Phase::Isotropic,
        Phase::HenyeyGreenstein(0.999),
        Phase::HenyeyGreenstein(-0.95),
    ];
    let mut faults = Worst::default();
    let grids = grids();
    for (i, (name, grid)) in grids.iter().enumerate() {
        let scene = around(grid, 2.5, extinction_for(grid, 30.0), phases[i % 3]);
        let seen = seen_by_paths(name, scene, &[grid]).expect("it renders");
        faults = faults.and(seen);
    }
    println!("{} real volumes", grids.len());
    assert_eq!(faults.figure, 0.0, "{}", faults.place);
}

/// Scattered light is what is taken out, by t-tests over passes of `photons`.
fn by_beams(grids: &[(String, Grid)], photons: u64, effort: Effort, most_error: f64) {
    let mut beams = Beams::default();
    for (name, grid) in grids {
        let scene = around(grid, 2.5, extinction_for(grid, 30.0), Phase::Isotropic);
        beams
            .add(name, scene, &[grid], photons)
            .expect("it renders");
    }
    let mut suite = Suite::new("furnace", effort);
    beams.finish(&mut suite, "real volumes", most_error);
    for check in &suite.checks {
        println!("{check}  {}", check.place);
        assert!(check.passed, "{check}");
    }
}

#[test]
fn beams_see_no_cloud() {
    let mut grids = grids();
    grids.retain(|(name, _)| name.contains("wdas_cloud") || name.contains("openvdb_smoke1"));
    by_beams(&grids, 20_000, Effort::Quick, 0.02);
}

#[test]
#[ignore = "every real volume by photons: a quarter of an hour"]
fn beams_see_no_real_volume() {
    by_beams(&grids(), 100_000, Effort::Exhaustive, 0.03);
}
