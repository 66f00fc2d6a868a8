//! Scenes that each lack something, and the same scenes in the renderer's general form.

use std::sync::atomic::AtomicBool;

use glam::{DAffine3, DVec3, IVec3};

use vpm_vdb::grid::Grid;
use vpm_vdb::progress::Silent;
use vpm_vdb::render::{Exec, Rendered, render_loaded};
use vpm_vdb::scene::{Emission, Fog, Light, Material, Object, Optics, Phase, Rgb, Scene, Shape};
use vpm_vdb::world::LoadedVolume;

use crate::fields::{grid, scene, smoke, volume};

/// A scene and the volumes that belong to it.
pub(crate) struct Case {
    /// The rule that it is about.
    pub(crate) name: &'static str,
    pub(crate) scene: Scene,
    pub(crate) grids: Vec<(Grid, Option<Grid>)>,
    /// Effects that are not active.
    pub(crate) without: &'static [&'static str],
    /// How many of its things are dropped.
    pub(crate) dropped: usize,
    /// Pictures are the same to the last bit.
    pub(crate) exact: bool,
}

impl Case {
    pub(crate) fn volumes(&self) -> Vec<LoadedVolume> {
        let load = |(density, temperature): &(Grid, Option<Grid>)| LoadedVolume {
            density: density.clone().into(),
            temperature: temperature.clone().map(Into::into),
        };
        self.grids.iter().map(load).collect()
    }

    /// Renders, pruned or not.
    pub(crate) fn render(&self, pruning: bool, seed: u64) -> Rendered {
        let mut scene = self.scene.clone();
        scene.settings.pruning = pruning;
        scene.settings.seed = seed;
        render_loaded(&scene, self.volumes(), &exec(&AtomicBool::new(false)))
            .expect("the scene can be rendered")
    }
}

pub(crate) fn exec(stop: &AtomicBool) -> Exec<'_> {
    Exec {
        threads: None,
        progress: &Silent,
        time_limit: None,
        warn: &|_| {},
        stop,
    }
}

const FORWARD: Phase = Phase::HenyeyGreenstein(0.6);
const WARM: Rgb = Rgb::new(0.9, 0.7, 0.5);

pub(crate) fn sun() -> Light {
    Light::Sun {
        direction: DVec3::new(0.3, -1.0, -0.2).normalize(),
        irradiance: Rgb::splat(3.0),
        angular_diameter: 0.0,
    }
}

fn lamp(power: f32) -> Light {
    Light::Point {
        position: DVec3::new(20.0, 45.0, 15.0),
        power: Rgb::splat(power),
    }
}

fn sky(radiance: f32) -> Light {
    Light::Sky {
        radiance: Rgb::splat(radiance),
    }
}

fn object(shape: Shape, material: Material) -> Object {
    Object {
        name: "floor".to_owned(),
        shape,
        transform: DAffine3::IDENTITY,
        material,
        interior: None,
    }
}

fn floor(material: Material) -> Object {
    let shape = Shape::Quad {
        corner: DVec3::new(-30.0, -14.0, 30.0),
        edge_u: DVec3::new(60.0, 0.0, 0.0),
        edge_v: DVec3::new(0.0, 0.0, -60.0),
    };
    object(shape, material)
}

fn ball(material: Material) -> Object {
    let shape = Shape::Sphere {
        center: DVec3::new(2.0, -3.0, 8.0),
        radius: 6.0,
    };
    object(shape, material)
}

fn diffuse() -> Material {
    Material::Diffuse {
        reflectance: Rgb::splat(0.6),
        texture: None,
    }
}

pub(crate) fn puff() -> Grid {
    grid(IVec3::splat(-24), IVec3::splat(24), smoke)
}

/// Smoke of some five optical depths, one metre to a voxel.
fn smoky(albedo: Rgb, phase: Phase, lights: Vec<Light>) -> (Scene, Vec<(Grid, Option<Grid>)>) {
    let mut scene = scene(75.0, [16, 16]);
    scene.volumes.push(volume(Rgb::splat(0.3), albedo, phase));
    scene.lights = lights;
    scene.settings.photons = 4000;
    scene.settings.neighbours = 20;
    scene.settings.passes = 2;
    scene.settings.spp = 2;
    scene.settings.max_bounces = 16;
    (scene, vec![(puff(), None)])
}

fn fog(albedo: f32, min: DVec3, max: DVec3) -> Fog {
    Fog {
        bounds: Some([min, max]),
        optics: Optics {
            extinction: Rgb::splat(0.08),
            albedo: Rgb::splat(albedo),
            phase: FORWARD,
        },
    }
}

/// One scene for each rule.
pub(crate) fn cases() -> Vec<Case> {
    let grey = Rgb::splat(0.85);
    let case = |name, (scene, grids), without| Case {
        name,
        scene,
        grids,
        without,
        dropped: 0,
        exact: false,
    };
    let mut all = vec![
        case(
            "absorption only",
            smoky(Rgb::ZERO, FORWARD, vec![sun(), sky(0.5)]),
            &[
                "single_scattering",
                "multiple_scattering",
                "anisotropic_phase",
            ],
        ),
        case(
            "nothing absorbs",
            smoky(Rgb::ONE, FORWARD, vec![sun()]),
            &["absorption"],
        ),
        case(
            "isotropic",
            smoky(WARM, Phase::Isotropic, vec![sun()]),
            &["anisotropic_phase"],
        ),
        case("grey", smoky(grey, FORWARD, vec![sun()]), &["chromatic"]),
        case(
            "no sky, no surfaces",
            smoky(WARM, FORWARD, vec![lamp(40_000.0)]),
            &["environment", "surfaces", "surface_photons"],
        ),
        case(
            "lights without area",
            smoky(WARM, Phase::Rayleigh, vec![sun(), lamp(40_000.0)]),
            &["area_lights"],
        ),
    ];
    // The sun keeps a disc: its points are drawn in either form.
    let mut pinhole = smoky(WARM, FORWARD, vec![sun()]);
    if let Light::Sun {
        angular_diameter, ..
    } = &mut pinhole.0.lights[0]
    {
        *angular_diameter = 3.0;
    }
    all.push(case("pinhole", pinhole, &["depth_of_field"]));
    let mut single = smoky(grey, FORWARD, vec![sun(), lamp(40_000.0)]);
    single.0.settings.max_bounces = 1;
    all.push(case("single scattering", single, &["multiple_scattering"]));
    let mut even = smoky(grey, FORWARD, vec![lamp(40_000.0)]);
    even.0.volumes.clear();
    even.1.clear();
    even.0.fogs.push(fog(
        0.85,
        DVec3::new(-16.0, -14.0, -10.0),
        DVec3::new(14.0, 13.0, 12.0),
    ));
    all.push(case("homogeneous fog", even, &["heterogeneous"]));
    let mut constant = smoky(WARM, FORWARD, vec![sun()]);
    let (low, high) = (IVec3::new(-11, -9, -13), IVec3::new(14, 12, 6));
    constant.1 = vec![(grid(low, high, |_| 0.4), None)];
    all.push(case("constant grid", constant, &["heterogeneous"]));
    let mut board = smoky(grey, FORWARD, vec![sun()]);
    board.0.objects.push(floor(diffuse()));
    board.0.objects.push(ball(diffuse()));
    all.push(case(
        "no specular surface, no inside",
        board,
        &["specular_surfaces", "medium_boundaries"],
    ));
    let mut mirror = smoky(grey, FORWARD, vec![sun()]);
    mirror.0.objects.push(floor(Material::Mirror {
        reflectance: Rgb::splat(0.8),
    }));
    all.push(case("no diffuse surface", mirror, &["surface_photons"]));
    let mut shaded = smoky(Rgb::ZERO, FORWARD, vec![sun(), lamp(40_000.0)]);
    shaded.0.objects.push(floor(diffuse()));
    all.push(case(
        "black smoke over one flat floor",
        shaded,
        &["surface_photons", "single_scattering"],
    ));
    let mut bubble = smoky(grey, FORWARD, vec![sun()]);
    bubble.0.objects.push(ball(Material::Interface));
    bubble.0.objects[0].interior = Some(Optics {
        extinction: Rgb::splat(0.2),
        albedo: Rgb::splat(0.7),
        phase: Phase::Isotropic,
    });
    all.push(case("medium in a ball", bubble, &["specular_surfaces"]));
    let mut glow = smoky(Rgb::ZERO, FORWARD, vec![]);
    glow.0.volumes[0].emission = Some(Emission::Blackbody {
        temperature: "heat".to_owned(),
        scale: 1500.0,
        radiance: 1.0,
    });
    glow.1[0].1 = Some(puff());
    let cold = (glow.0.clone(), glow.1.clone());
    all.push(case("emission only", glow, &["single_scattering"]));
    let mut cold = cold;
    cold.0.volumes[0].emission = Some(Emission::Blackbody {
        temperature: "heat".to_owned(),
        scale: 200.0,
        radiance: 1.0,
    });
    cold.0.volumes[0].optics.albedo = grey;
    cold.0.lights.push(sun());
    all.push(case("too cold to glow", cold, &["emission", "chromatic"]));
    let mut unlit = smoky(grey, FORWARD, vec![lamp(0.0), lamp(40_000.0), lamp(0.0)]);
    unlit.0.lights.push(sky(0.0));
    let mut unlit = case("lights without power", unlit, &["environment"]);
    unlit.dropped = 3;
    all.push(unlit);
    // One behind the camera and out of the sun's way, one of no density, and a fog to the side.
    let mut aside = smoky(grey, FORWARD, vec![sun()]);
    aside.0.settings.max_bounces = 1;
    for _ in 0..2 {
        aside.0.volumes.push(aside.0.volumes[0].clone());
    }
    aside.0.volumes[1].transform = DAffine3::from_translation(DVec3::new(0.0, -10.0, 140.0));
    aside.1.push((puff(), None));
    aside
        .1
        .push((grid(IVec3::ZERO, IVec3::splat(8), |_| 0.0), None));
    aside.0.fogs.push(fog(
        0.9,
        DVec3::new(90.0, -20.0, -20.0),
        DVec3::new(120.0, 20.0, 20.0),
    ));
    let mut aside = case("volumes out of sight", aside, &["multiple_scattering"]);
    aside.dropped = 3;
    all.push(aside);
    // Out of sight too, but the sun shines through it on what is seen: it is kept.
    let mut shade = smoky(grey, FORWARD, vec![sun()]);
    shade.0.settings.max_bounces = 1;
    shade.0.volumes.push(shade.0.volumes[0].clone());
    shade.0.volumes[1].transform = DAffine3::from_translation(DVec3::new(-18.0, 60.0, 12.0));
    shade.1.push((puff(), None));
    all.push(case("shade from out of sight", shade, &["chromatic"]));
    for case in &mut all {
        case.exact = matches!(case.name, "absorption only" | "emission only");
    }
    all
}
