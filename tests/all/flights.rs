//! Flights side by side against the same flights one by one.

use glam::{DAffine3, DQuat, DVec3, IVec3, Vec3};

use vpm_vdb::grid::Grid;
use vpm_vdb::medium::{Field, Medium};
use vpm_vdb::phase::PhaseFunction;
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::Rng;
use vpm_vdb::spectrum::Spectrum;
use vpm_vdb::tracking::{Flights, Hero, Sampler, lanes_of, sample_free_flight};

use crate::fields::{direction, generated, grid, medium_at, ray_through, real_density, rng, smoke};

/// A medium whose voxels are turned, stretched and moved in the world.
fn turned<S: Spectrum>(grid: &Grid, sigma_t: S) -> Medium<S> {
    let after = DAffine3::from_scale_rotation_translation(
        DVec3::new(0.7, 1.0, 1.3),
        DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0),
        DVec3::new(3.0, -20.0, 7.0),
    );
    medium_at(grid, &after, sigma_t)
}

/// A photon, once in a lane and once alone.
struct Photon<S> {
    ray: Ray,
    t_max: f32,
    hero: Hero<S>,
    sampler: Sampler,
    alone: Sampler,
}

/// Rays through the grid and past it, along axes too; from outside, inside, and beyond an end.
fn start<S>(grid: &Grid, medium: &Medium<S>, random: &mut Rng) -> (Ray, f32) {
    let Field::Grid(field) = &medium.field else {
        panic!("a grid");
    };
    let to_world = field.placement.to_world();
    let mut ray = ray_through(grid, random);
    if random.below(4) == 0 {
        ray.direction = Vec3::AXES[random.below(3) as usize];
    }
    if random.below(4) == 0 {
        ray.origin = grid.support().center();
    }
    if random.below(8) == 0 {
        ray.origin += 1000.0 * direction(random);
    }
    let length = grid.support().size().length();
    let t_max = match random.below(3) {
        0 => length * random.uniform(),
        _ => f32::INFINITY,
    };
    let ray = Ray {
        origin: to_world.transform_point3(ray.origin),
        direction: to_world.transform_vector3(ray.direction).normalize(),
    };
    (ray, t_max)
}

/// Flies many photons, each several times in a row, and compares all of it; collisions, and flights
/// without.
fn compare<S: Spectrum>(name: &str, grid: &Grid, sigma_t: S) -> [u32; 2] {
    let media = [turned(grid, sigma_t)];
    let mut flights = Flights::new(&media[0]).expect("a thin grey medium of a grid");
    let mut random = rng(77);
    let mut lanes: Vec<Option<Photon<S>>> = (0..Flights::LANES).map(|_| None).collect();
    let (mut begun, mut collisions, mut passed, mut lookups) = (0, 0, 0, 0);
    let mut waiting: Vec<usize> = (0..Flights::LANES).collect();
    while !waiting.is_empty() || lanes.iter().any(Option::is_some) {
        for lane in waiting.drain(..) {
            let mut flies = false;
            while begun < 20_000 && !flies {
                let (ray, t_max) = start(grid, &media[0], &mut random);
                let photon = lanes[lane].get_or_insert_with(|| {
                    let mut sampler = Sampler::new(rng(1000 + begun));
                    let hero = Hero::choose(&mut sampler.rng);
                    Photon {
                        ray,
                        t_max,
                        hero,
                        alone: sampler.clone(),
                        sampler,
                    }
                });
                (photon.ray, photon.t_max) = (ray, t_max);
                begun += 1;
                let (hero, sampler) = (&mut photon.hero, &mut photon.sampler);
                flies = flights.set_out(lane, &ray, t_max, hero, sampler);
                if flies {
                    continue;
                }
                let missed = sample_free_flight(
                    &media,
                    &ray,
                    t_max,
                    &mut photon.hero.clone(),
                    &mut photon.alone,
                );
                assert_eq!(missed, None, "{name}: misses, {ray:?} to {t_max}");
            }
            if !flies && let Some(photon) = lanes[lane].take() {
                lookups += photon.alone.counters.density_lookups;
            }
        }
        let ended = flights.advance();
        assert_eq!(ended.collided & ended.left, 0, "{name}: ended twice");
        for lane in lanes_of(ended.collided | ended.left) {
            let mut photon = lanes[lane].take().expect("a photon in the lane");
            let t = flights.end(lane, &mut photon.sampler);
            let found = (ended.collided >> lane & 1 == 1).then_some(t);
            let (ray, t_max) = (&photon.ray, photon.t_max);
            let mut hero = photon.hero.clone();
            let own = sample_free_flight(&media, ray, t_max, &mut hero, &mut photon.alone);
            let own = own.map(|collision| collision.t);
            assert_eq!(found, own, "{name}: {ray:?} to {t_max}");
            assert_eq!(hero.weight(), photon.hero.weight(), "{name}: weights");
            collisions += u32::from(found.is_some());
            passed += u32::from(found.is_none());
            if random.below(4) > 0 {
                // It goes on with what is left of its numbers.
                lanes[lane] = Some(photon);
            } else {
                let (mut lane, mut alone) = (photon.sampler.rng, photon.alone.rng);
                assert_eq!(lane.bits(), alone.bits(), "{name}: the stream goes on");
                lookups += photon.alone.counters.density_lookups;
            }
            waiting.push(lane);
        }
    }
    assert_eq!(flights.lookups(), lookups, "{name}: look-ups");
    [collisions, passed]
}

/// Fused products are one rounding everywhere or nowhere.
#[cfg(any(target_feature = "fma", target_arch = "aarch64"))]
#[test]
fn flights_in_lanes_are_the_flights_alone() {
    let mut fields = generated();
    fields.push(("smoke", grid(IVec3::splat(-24), IVec3::splat(24), smoke)));
    for file in ["openvdb_smoke1_v222.vdb", "wdas_cloud_sixteenth.vdb"] {
        if let Some(real) = real_density(file) {
            fields.push(("real", real));
        }
    }
    for (name, grid) in fields {
        let size = grid.support().size().max_element();
        // From side to side, and from voxel to voxel.
        let [thin, thick] = [10.0 / size, 10.0].map(|per_voxel| per_voxel / grid.range()[1]);
        let of_thin = compare(name, &grid, thin);
        let of_thick = compare(name, &grid, Vec3::splat(thick));
        for which in 0..2 {
            let count = of_thin[which] + of_thick[which];
            assert!(count > 100, "{name}: {of_thin:?}, {of_thick:?}");
        }
    }
}

/// What lanes cannot do is not begun in them.
#[test]
fn colours_and_spikes_are_not_for_lanes() {
    let field = grid(IVec3::splat(-8), IVec3::splat(8), smoke);
    assert!(Flights::new(&turned(&field, Vec3::new(1.0, 0.5, 1.0))).is_none());
    assert!(Flights::new(&turned(&field, 1e4)).is_none());
    assert!(Flights::new(&turned(&field, 1.0)).is_some());
    let fog = Medium {
        sigma_t: 1.0,
        albedo: 1.0,
        phase: PhaseFunction::Isotropic,
        field: Field::Constant { bounds: None },
        emission: None,
    };
    assert!(Flights::new(&fog).is_none());
}
