//! Pruned and general form make one picture, and what is pruned is not done.

use vpm_vdb::effects::EffectPlan;

use super::scenes::cases;
use crate::stats::{Welford, t_bound};

/// Renders of each form, all of seeds of their own.
const SEEDS: u64 = 16;

/// Edges of what is compared: pixels, blocks, the picture. Each has a bound of its own.
const SIZES: [u32; 3] = [1, 4, 16];

/// The means of all squares of an edge, channel by channel.
fn figures(film: &vpm_vdb::film::Film, size: u32) -> Vec<f64> {
    let [width, height] = film.resolution();
    let mut out = Vec::new();
    {
        for (y, x) in (0..height)
            .step_by(size as usize)
            .flat_map(|y| (0..width).step_by(size as usize).map(move |x| (y, x)))
        {
            let mut sum = glam::DVec3::ZERO;
            for j in 0..size {
                for i in 0..size {
                    sum += film.mean(x + i, y + j);
                }
            }
            out.extend((sum / f64::from(size * size)).to_array());
        }
    }
    out
}

#[test]
fn pruning_changes_no_picture() {
    let cases = cases();
    assert!(cases.len() >= 12, "one scene for each rule");
    for case in &cases {
        let films = [true, false].map(|pruning| {
            let seeds = (0..SEEDS).map(|seed| seed + if pruning { 0 } else { 1000 });
            let films = seeds.map(|seed| case.render(pruning, seed).film);
            films.collect::<Vec<_>>()
        });
        let mut line = String::new();
        for size in SIZES {
            let [pruned, general] = films.each_ref().map(|films| {
                let mut sums: Vec<Welford> = Vec::new();
                for film in films {
                    let values = figures(film, size);
                    sums.resize(values.len(), Welford::default());
                    for (sum, value) in sums.iter_mut().zip(values) {
                        sum.add(value);
                    }
                }
                sums
            });
            let n = pruned.len();
            let bound = t_bound(cases.len() * n, (SEEDS - 1) as f64);
            let mut worst = 0.0f64;
            for (i, (a, b)) in pruned.iter().zip(&general).enumerate() {
                let gap = (a.mean() - b.mean()).abs();
                // Where neither form has noise, rounding is left.
                let error = (a.variance_of_mean() + b.variance_of_mean()).sqrt();
                let error = error.max(1e-6 * a.mean().abs() / bound);
                if gap > 0.0 {
                    worst = worst.max(gap / error);
                }
                assert!(
                    gap <= bound * error,
                    "{}: square {i} of {size} pixels is {} pruned, {} in general, +- {error}",
                    case.name,
                    a.mean(),
                    b.mean()
                );
            }
            let (a, b) = (&pruned[n - 1], &general[n - 1]);
            if size == SIZES[2] {
                let error = (a.variance_of_mean() + b.variance_of_mean()).sqrt();
                let (ratio, error) = (a.mean() / b.mean(), error / b.mean());
                line += &format!(", pruned / general {ratio:.4} +- {error:.4}");
            }
            line += &format!(", {size} px {worst:.1} of {bound:.1}");
        }
        println!("{}{line}", case.name);
    }
}

/// With one seed, where both forms draw the same numbers.
#[test]
fn pruned_pictures_without_scattering_are_the_same_to_the_last_bit() {
    let exact: Vec<_> = cases().into_iter().filter(|c| c.exact).collect();
    assert!(exact.len() >= 2, "there are such scenes");
    for case in exact {
        let [pruned, general] = [true, false].map(|p| case.render(p, 3).film);
        assert!(pruned.image_mean().mean.x > 0.0, "{}: a picture", case.name);
        assert!(pruned.to_bytes() == general.to_bytes(), "{}", case.name);
    }
}

/// Counts of effects that are not active are 0; those of the general form are not, where the
/// renderer counts something that it does for nothing.
#[test]
fn what_is_pruned_is_not_done() {
    // What the general form does for nothing; the others count what the scene has none of.
    let in_vain = [
        "chromatic",
        "depth_of_field",
        "surfaces",
        "heterogeneous",
        "area_lights",
        "medium_boundaries",
    ];
    for case in cases() {
        let [pruned, general] = [true, false].map(|p| case.render(p, 1).report);
        assert_eq!(
            pruned.dropped.len(),
            case.dropped,
            "{}: {:?}",
            case.name,
            pruned.dropped
        );
        assert!(general.dropped.is_empty(), "{}", case.name);
        for (effect, general) in pruned.effects.iter().zip(&general.effects) {
            let name = format!("{}, {}", case.name, effect.name);
            assert_eq!(effect.name, general.name, "{name}");
            assert!(general.active && !general.form.is_empty(), "{name}");
            assert!(!effect.reason.is_empty(), "{name}");
            assert_eq!(effect.form.is_empty(), !effect.active, "{name}");
            let (count, general) = (effect.count.expect("counted"), general.count);
            if !effect.active {
                assert_eq!(count, 0, "{name}: {}", effect.reason);
            }
            if case.without.contains(&effect.name.as_str()) {
                assert!(!effect.active, "{name}: {}", effect.reason);
                let vain = in_vain.contains(&effect.name.as_str());
                let lines = effect.name != "medium_boundaries" || case.scene.lights.len() > 1;
                if vain && lines {
                    assert!(general > Some(0), "{name}: the general form does it");
                }
            }
        }
        let scatters = |name: &str| pruned.effects.iter().any(|e| e.name == name && e.active);
        let photons = scatters("multiple_scattering") || scatters("surface_photons");
        assert_eq!(pruned.photons.emitted > 0, photons, "{}", case.name);
        assert_eq!(pruned.photons.stored > 0, photons, "{}", case.name);
        assert!(
            general.photons.emitted > 0 || case.scene.lights.is_empty(),
            "{}",
            case.name
        );
    }
}

/// The general plan is general in every choice; one that is left out would be measured as free.
#[test]
fn no_pruning_is_general_in_everything() {
    for case in cases() {
        let mut scene = case.scene.clone();
        scene.settings.pruning = false;
        let plan = EffectPlan::new(&scene, &case.volumes());
        let choices = [
            plan.chromatic,
            plan.headings,
            plan.photons,
            plan.direct,
            plan.emission,
            plan.surface_photons,
            plan.follow,
            plan.lens,
            plan.general == vpm_vdb::effects::General::ALL,
        ];
        assert_eq!(choices, [true; 9], "{}", case.name);
    }
}
