//! What each effect's rule saves: every scene as its plan has it, and with general forms in its
//! place, in turn, in one process.
//!
//! ```text
//! cargo bench --bench effects [-- WORD]       # rows whose rule contains WORD
//! ```
//!
//! A row names the stage whose time it compares; memory is that of photons and maps together. "one"
//! is the effect's own general form with all else pruned, "all" is `--no-pruning`. Times are the
//! least of several rounds; the ratio is the median over the rounds, whose forms ran side by side.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use glam::{DAffine3, DVec3, IVec3, Vec3};

use vpm_vdb::effects::EffectPlan;
use vpm_vdb::grid::Grid;
use vpm_vdb::grid::load::load_volumes;
use vpm_vdb::march;
use vpm_vdb::progress::Silent;
use vpm_vdb::ray::Ray;
use vpm_vdb::render::{Exec, render_as};
use vpm_vdb::report::Report;
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::scene::{
    Direct, Emission, Fog, Light, Material, Object, Optics, Phase, Rgb, Scene, Shape,
};
use vpm_vdb::tracking::{Hero, Sampler, sample_free_flight};
use vpm_vdb::world::{LoadedVolume, World};

const ROUNDS: usize = 3;

/// Seconds of a render that a row is about.
type Seconds = fn(&Report) -> f64;

fn whole(report: &Report) -> f64 {
    report.time_s.total
}

fn gather(report: &Report) -> f64 {
    report.time_s.gather
}

fn tracing(report: &Report) -> f64 {
    report.time_s.photons
}

fn photons_and_camera(report: &Report) -> f64 {
    report.time_s.photons + report.time_s.map + report.time_s.gather
}

/// A scene, the general form to compare with, and what to look at.
struct Row {
    rule: &'static str,
    scene: Scene,
    volumes: Vec<LoadedVolume>,
    /// Turns the pruned plan into the form to compare with; none is `--no-pruning`.
    one: Option<fn(&mut EffectPlan)>,
    stage: (&'static str, Seconds),
    /// The ratio that the rule is to reach, of time or of memory.
    bar: Option<f64>,
}

/// One render's figures.
struct Figures {
    seconds: f64,
    bytes: u64,
}

fn run(row: &Row, general: bool) -> Figures {
    let mut scene = row.scene.clone();
    scene.settings.pruning = !general || row.one.is_some();
    let mut plan = EffectPlan::new(&scene, &row.volumes);
    if let (true, Some(one)) = (general, row.one) {
        one(&mut plan);
    }
    let stop = AtomicBool::new(false);
    let exec = Exec {
        threads: None,
        progress: &Silent,
        time_limit: None,
        warn: &|_| {},
        stop: &stop,
    };
    let volumes = row.volumes.clone();
    let rendered = render_as(&scene, volumes, plan, &exec, Instant::now());
    let report = rendered.expect("the scene can be rendered").report;
    Figures {
        seconds: (row.stage.1)(&report),
        bytes: report.memory_bytes.photons + report.memory_bytes.map,
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn compare(row: &Row) {
    let (mut least, mut ratios, mut bytes) = ([f64::INFINITY; 2], Vec::new(), [0; 2]);
    for _ in 0..ROUNDS {
        let figures = [false, true].map(|general| run(row, general));
        for i in 0..2 {
            least[i] = least[i].min(figures[i].seconds);
            bytes[i] = figures[i].bytes;
        }
        ratios.push(figures[1].seconds / figures[0].seconds);
    }
    let ratio = median(&mut ratios);
    let memory = bytes[1] as f64 / bytes[0] as f64;
    let reached = row.bar.map_or(String::new(), |bar| {
        let best = if memory.is_finite() {
            ratio.max(memory)
        } else {
            ratio
        };
        format!("{bar} {}", if best >= bar { "reached" } else { "MISSED" })
    });
    let form = if row.one.is_some() { "one" } else { "all" };
    let mebibytes = |b: u64| b as f64 / 1_048_576.0;
    println!(
        "| {} | {} | {form} | {:.1} | {:.1} | {ratio:.2} | {:.1} | {:.1} | {} | {reached} |",
        row.rule,
        row.stage.0,
        1e3 * least[0],
        1e3 * least[1],
        mebibytes(bytes[0]),
        mebibytes(bytes[1]),
        if memory.is_finite() {
            format!("{memory:.2}")
        } else {
            "-".to_owned()
        },
    );
}

/// Nanoseconds of a free flight and of a transmittance from points inside the first medium, over
/// all media of a world.
fn flights(world: &World<f32>) -> [f64; 2] {
    const RAYS: u64 = 200_000;
    let bounds = world.bounds;
    let mut rays = Rng::stream(1, Stage::Check, 0, 0);
    let mut unit = || Vec3::new(rays.uniform(), rays.uniform(), rays.uniform());
    let rays: Vec<Ray> = (0..RAYS)
        .map(|_| Ray {
            origin: bounds.min + bounds.size() * unit(),
            direction: (unit() - 0.5).normalize(),
        })
        .collect();
    let mut sampler = Sampler::new(Rng::stream(2, Stage::Check, 0, 0));
    let mut sum = 0.0f64;
    let clock = Instant::now();
    for ray in &rays {
        let mut hero = Hero::choose(&mut sampler.rng);
        let hit = sample_free_flight(&world.media, ray, f32::INFINITY, &mut hero, &mut sampler);
        sum += hit.map_or(0.0, |c| f64::from(c.t));
    }
    let flight = clock.elapsed();
    let clock = Instant::now();
    for ray in &rays {
        let tr: f32 = march::transmittance(&world.media, ray, f32::INFINITY, &mut sampler);
        sum += f64::from(tr);
    }
    let transmittance = clock.elapsed();
    assert!(sum.is_finite(), "distances and transmittances");
    [flight, transmittance].map(|t| 1e9 * t.as_secs_f64() / RAYS as f64)
}

/// Tracking alone: closed form against the grid that stands for it.
fn compare_tracking(rule: &str, scene: &Scene, volumes: &[LoadedVolume], bar: f64) {
    let worlds = [false, true].map(|general| {
        let mut scene = scene.clone();
        scene.settings.pruning = !general;
        let plan = EffectPlan::new(&scene, volumes);
        World::<f32>::with(&scene, volumes.to_vec(), plan.general).expect("no surfaces to fail")
    });
    let mut least = [[f64::INFINITY; 3]; 2];
    let mut ratios = [Vec::new(), Vec::new(), Vec::new()];
    for _ in 0..ROUNDS {
        let found = worlds.each_ref().map(|world| {
            let [flight, transmittance] = flights(world);
            [flight, transmittance, flight + transmittance]
        });
        for what in 0..3 {
            for (least, found) in least.iter_mut().zip(&found) {
                least[what] = least[what].min(found[what]);
            }
            ratios[what].push(found[1][what] / found[0][what]);
        }
    }
    let names = ["free flight", "transmittance", "both"];
    for (what, name) in names.into_iter().enumerate() {
        let ratio = median(&mut ratios[what]);
        let reached = match (what, ratio >= bar) {
            (2, true) => format!("{bar} reached"),
            (2, false) => format!("{bar} MISSED"),
            _ => String::new(),
        };
        println!(
            "| {rule} | {name}, ns | one | {:.0} | {:.0} | {ratio:.2} | | | | {reached} |",
            least[0][what], least[1][what]
        );
    }
}

fn sun(diameter: f64) -> Light {
    Light::Sun {
        direction: DVec3::new(-0.8, -0.45, 0.1).normalize(),
        irradiance: Rgb::splat(8.0),
        angular_diameter: diameter,
    }
}

fn fog(extinction: f32) -> Fog {
    Fog {
        bounds: Some([DVec3::new(-0.6, 0.0, -0.6), DVec3::new(0.6, 2.0, 0.6)]),
        optics: Optics {
            extinction: Rgb::splat(extinction),
            albedo: Rgb::splat(0.9),
            phase: Phase::HenyeyGreenstein(0.5),
        },
    }
}

fn object(shape: Shape, material: Material) -> Object {
    Object {
        name: "object".to_owned(),
        shape,
        transform: DAffine3::IDENTITY,
        material,
        interior: None,
    }
}

fn ball() -> Object {
    let shape = Shape::Sphere {
        center: DVec3::new(0.03, 0.75, 0.01),
        radius: 0.16,
    };
    object(shape, diffuse())
}

fn floor() -> Object {
    let shape = Shape::Quad {
        corner: DVec3::new(-2.0, 0.0, 2.0),
        edge_u: DVec3::new(4.0, 0.0, 0.0),
        edge_v: DVec3::new(0.0, 0.0, -4.0),
    };
    object(shape, diffuse())
}

fn diffuse() -> Material {
    Material::Diffuse {
        reflectance: Rgb::splat(0.5),
        texture: None,
    }
}

/// The repository's smoke in grey, under a sun without a disc.
fn smoke() -> (Scene, Vec<LoadedVolume>) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/rising_smoke.toml");
    let mut scene = Scene::load(&file).expect("the scene is part of the repository");
    scene.objects.clear();
    scene.lights = vec![sun(0.0)];
    scene.camera.resolution = [160, 200];
    scene.settings.passes = 1;
    scene.settings.photons = 400_000;
    scene.settings.max_bounces = 64;
    let volumes = load_volumes(&scene, &|_| {}).expect("the volume is part of the repository");
    (scene, volumes)
}

/// A grid of one value all over a box, where the smoke was.
fn constant() -> Grid {
    let to_world = DAffine3::from_translation(DVec3::new(-0.6, 0.0, -0.6))
        * DAffine3::from_scale(DVec3::splat(1.2 / 96.0));
    Grid::from_fn(IVec3::splat(3), IVec3::new(92, 155, 92), to_world, |_| 1.0)
        .expect("a small grid can be built")
}

/// Single scattering, with the photons of the scene file.
fn once(scene: &mut Scene, resolution: [u32; 2]) {
    scene.settings.max_bounces = 1;
    scene.settings.photons = 1_000_000;
    scene.camera.resolution = resolution;
}

fn rows() -> Vec<Row> {
    let row = |rule, edit: &dyn Fn(&mut Scene, &mut Vec<LoadedVolume>), one, stage, bar| {
        let (mut scene, mut volumes) = smoke();
        edit(&mut scene, &mut volumes);
        Row {
            rule,
            scene,
            volumes,
            one,
            stage,
            bar,
        }
    };
    let all = ("whole", whole as Seconds);
    let gather = ("gather", gather as Seconds);
    let work = ("photons, map, gather", photons_and_camera as Seconds);
    let tracing = ("photons", tracing as Seconds);
    let black = |s: &mut Scene, _: &mut Vec<LoadedVolume>| {
        s.volumes[0].optics.albedo = Rgb::ZERO;
        s.lights.push(Light::Sky {
            radiance: Rgb::splat(0.3),
        });
    };
    let nothing = |_: &mut Scene, _: &mut Vec<LoadedVolume>| {};
    let isotropic = |s: &mut Scene, _: &mut Vec<LoadedVolume>| {
        s.volumes[0].optics.phase = Phase::Isotropic;
    };
    let grid = |s: &mut Scene, v: &mut Vec<LoadedVolume>| {
        s.volumes[0].optics.extinction = Rgb::splat(4.0);
        v[0].density = constant().into();
    };
    vec![
        row("absorption only", &black, None, all, Some(20.0)),
        row(
            "absorption only, photons",
            &black,
            Some(|p| p.photons = true),
            all,
            None,
        ),
        row(
            "max_bounces 1",
            &|s, _| once(s, [160, 200]),
            None,
            all,
            Some(3.0),
        ),
        row(
            "max_bounces 1, photons",
            &|s, _| once(s, [160, 200]),
            Some(|p| p.photons = true),
            all,
            None,
        ),
        row(
            "max_bounces 1, 640 x 800",
            &|s, _| once(s, [640, 800]),
            None,
            all,
            None,
        ),
        row(
            "grey",
            &nothing,
            Some(|p| p.chromatic = true),
            gather,
            Some(1.5),
        ),
        row(
            "grey, isotropic",
            &isotropic,
            Some(|p| {
                p.chromatic = true;
                p.headings = true;
            }),
            gather,
            None,
        ),
        row(
            "grey, photons only",
            &|s, _| s.settings.direct = Direct::Photons,
            Some(|p| p.chromatic = true),
            gather,
            None,
        ),
        row(
            "isotropic",
            &isotropic,
            Some(|p| p.headings = true),
            gather,
            Some(1.2),
        ),
        row(
            "homogeneous fog",
            &|s, v| {
                s.volumes.clear();
                v.clear();
                s.fogs.push(fog(4.0));
            },
            Some(|p| p.general.grids = true),
            tracing,
            None,
        ),
        row(
            "constant grid",
            &grid,
            Some(|p| p.general.grids = true),
            tracing,
            None,
        ),
        row(
            "no surfaces",
            &nothing,
            Some(|p| p.general.hierarchy = true),
            work,
            None,
        ),
        row(
            "no specular surface",
            &|s, _| s.objects.push(ball()),
            Some(|p| p.follow = true),
            work,
            None,
        ),
        row(
            "no object with an inside",
            &|s, _| s.objects.push(ball()),
            Some(|p| p.general.boundaries = true),
            work,
            None,
        ),
        row(
            "no surface photons",
            &|s, _| {
                s.volumes[0].optics.albedo = Rgb::ZERO;
                s.objects.push(floor());
            },
            Some(|p| {
                p.photons = true;
                p.surface_photons = true;
            }),
            work,
            None,
        ),
        row(
            "lights without area",
            &nothing,
            Some(|p| p.general.points = true),
            gather,
            None,
        ),
        row("pinhole", &nothing, Some(|p| p.lens = true), work, None),
        row(
            "too cold to glow",
            &|s, v| {
                s.volumes[0].emission = Some(Emission::Blackbody {
                    temperature: "density".to_owned(),
                    scale: 10.0,
                    radiance: 1.0,
                });
                v[0].temperature = Some(v[0].density.clone());
            },
            Some(|p| {
                p.emission = true;
                p.chromatic = true;
            }),
            gather,
            None,
        ),
        row(
            "volume out of sight",
            &|s, v| {
                s.settings.max_bounces = 1;
                let mut other = s.volumes[0].clone();
                other.transform = DAffine3::from_translation(DVec3::new(0.8, -1.0, 8.0));
                s.volumes.push(other);
                v.push(v[0].clone());
            },
            Some(|p| p.kept = vpm_vdb::effects::Kept::default()),
            all,
            None,
        ),
        row("all of it", &nothing, None, all, None),
    ]
}

fn main() {
    // cargo bench passes options of its own.
    let word = std::env::args()
        .skip(1)
        .find(|a| !a.starts_with('-'))
        .unwrap_or_default();
    println!(
        "| rule | stage | form | pruned, ms | general, ms | times | pruned, MiB | general, MiB | times \
         | bar |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for row in rows().iter().filter(|r| r.rule.contains(&word)) {
        compare(row);
    }
    if "homogeneous fog tracking constant grid".contains(&word) {
        let (mut scene, mut volumes) = smoke();
        scene.volumes[0].optics.extinction = Rgb::splat(4.0);
        volumes[0].density = constant().into();
        compare_tracking("constant grid", &scene, &volumes, 3.0);
        scene.volumes.clear();
        scene.fogs.push(fog(4.0));
        compare_tracking("homogeneous fog", &scene, &[], 3.0);
    }
}
