//! The scene file: every section, key, unit, default and range.
//!
//! TOML. Paths are relative to the file. A colour is a number (grey) or `[r, g, b]`, linear
//! Rec. 709. Unknown keys are faults, and all faults are reported at once (see `keys`).
//!
//! | section | number | what |
//! |---|---|---|
//! | `[camera]` | one | where the picture is taken from |
//! | `[render]` | none or one | how it is computed; command-line options win |
//! | `[[volume]]` | any | medium from a .vdb file |
//! | `[[fog]]` | any | homogeneous medium |
//! | `[[light]]` | any | light, one kind each |
//! | `[[object]]` | any | surface |
//!
//! Each function below reads one section: a line a key, with its range; its page lists units and
//! defaults.

mod light;
mod object;

use glam::{DAffine3, DMat3, DVec3};

use super::item::{ABOVE_0, FROM_0, Item, Limits, SHARE};
use super::keys::Keys;
use super::{
    Camera, Convert, Direct, Emission, Fog, Kernel, Lens, March, Method, Optics, Phase, Scene,
    Search, Settings, Volume,
};

/// Most pixels along an edge of the picture.
pub(crate) const MAX_RESOLUTION: u32 = 16_384;
/// Most photons of a pass: what fits memory is far below.
pub(crate) const MAX_PHOTONS: u64 = 10_000_000_000;
/// Most passes, samples of a pixel, neighbours.
pub(crate) const MAX_COUNT: u32 = 1_000_000;

/// The whole document. `None` after noting faults.
pub(super) fn scene(t: &Keys<'_>, name: String) -> Option<Scene> {
    let camera = t.need("camera", |v| v.table(camera));
    let settings = t.may("render", |v| v.table(|t| Some(settings(t))));
    let volumes = t.each("volume", |_, v| v.table(volume));
    let fogs = t.each("fog", |_, v| v.table(fog));
    let lights = t.each("light", |_, v| light::light(v));
    let objects = t.each("object", |i, v| v.table(|t| object::object(t, i)));
    Some(Scene {
        name,
        camera: camera?,
        settings: settings.unwrap_or_default(),
        volumes,
        fogs,
        lights,
        objects,
    })
}

/// `[camera]`
///
/// | key | unit | default | range |
/// |---|---|---|---|
/// | `position` | m | needed | |
/// | `look_at`: the middle of the picture | m | needed | other than `position` |
/// | `up` | | `[0, 1, 0]` | not along the view |
/// | `vertical_fov`: across the height | degrees | 40 | 0 to 180, excluded |
/// | `resolution`: width, height | px | `[640, 480]` | 1 to 16384 each |
/// | `lens.radius` | m | pinhole | above 0 |
/// | `lens.focus_distance`: along the view | m | needed with `lens` | above 0 |
fn camera(t: &Keys<'_>) -> Option<Camera> {
    let position = t.need("position", Item::point);
    let look_at = t.need("look_at", Item::point);
    let up = t.may("up", Item::direction).unwrap_or(DVec3::Y);
    let fov = Limits(|v| v > 0.0 && v < 180.0, "above 0 and below 180");
    let vertical_fov = t.may("vertical_fov", |v| v.number(fov)).unwrap_or(40.0);
    let resolution = t.may("resolution", |v| {
        v.list("[width, height]", |v| v.whole32(1..=MAX_RESOLUTION))
    });
    let lens = t.may("lens", |v| v.table(lens));

    let (position, look_at) = (position?, look_at?);
    let view = look_at - position;
    if !view.length_squared().is_normal() {
        let message = "`look_at` is where the camera stands; it has to be somewhere else";
        t.faults.note(t.span_of("look_at"), message);
    } else if up.normalize().cross(view.normalize()).length() < 1e-6 {
        let message = "`up` is along the view; it has to point to a side of it";
        let at = if t.has("up") { "up" } else { "look_at" };
        t.faults.note(t.span_of(at), message);
    }
    Some(Camera {
        position,
        look_at,
        up,
        vertical_fov,
        resolution: resolution.unwrap_or([640, 480]),
        lens,
    })
}

fn lens(t: &Keys<'_>) -> Option<Lens> {
    let radius = t.need("radius", |v| v.number(ABOVE_0));
    let focus_distance = t.need("focus_distance", |v| v.number(ABOVE_0));
    Some(Lens {
        radius: radius?,
        focus_distance: focus_distance?,
    })
}

/// `[render]`
///
/// | key | default | range |
/// |---|---|---|
/// | `method` | `"beam"` | `"beam"`, `"point"`, `"path"` |
/// | `max_bounces`: scattering orders; 1 is single scattering, 0 none | 128 | to 1 000 000 |
/// | `photons`: emitted in a pass | 1 000 000 | 1 to 10^10 |
/// | `passes` | 8 | 1 to 1 000 000 |
/// | `spp`: camera rays of a pixel, in each pass (beam, point) or in all (path) | 1 | 1 to 1 000 000 |
/// | `direct`: first order from points on the ray, or from photons | `"sampled"` | `"sampled"`, `"photons"` |
/// | `march`: optical depth of camera rays, and steps of the point estimate | `"exact"` | `"exact"`, `{ step = voxels }` above 0 |
/// | `kernel` | `"biweight"` | `"constant"`, `"biweight"`, `"epanechnikov"` |
/// | `neighbours`: photons within the radius of a photon | 50 | 1 to 1 000 000 |
/// | `search`: photons that the point estimate counts at a step: the `neighbours` nearest, or all within their own radius | `"nearest"` | `"nearest"`, `"radius"` |
/// | `exposure` of the PNG \[stops\] | 0 | -100 to 100 |
/// | `seed` | 0 | 0 to 2^64 - 1 |
fn settings(t: &Keys<'_>) -> Settings {
    let d = Settings::default();
    let methods = Method::ALL.map(|m| (m.name(), m));
    let directs = [("sampled", Direct::Sampled), ("photons", Direct::Photons)];
    let searches = [("nearest", Search::Nearest), ("radius", Search::Radius)];
    let kernels = [
        ("constant", Kernel::Constant),
        ("biweight", Kernel::Biweight),
        ("epanechnikov", Kernel::Epanechnikov),
    ];
    let stops = Limits(|v| v.abs() <= 100.0, "from -100 to 100");
    Settings {
        method: t.may("method", |v| v.word(&methods)).unwrap_or(d.method),
        max_bounces: t
            .may("max_bounces", |v| v.whole32(0..=MAX_COUNT))
            .unwrap_or(d.max_bounces),
        photons: t
            .may("photons", |v| v.whole(1..=MAX_PHOTONS))
            .unwrap_or(d.photons),
        passes: t
            .may("passes", |v| v.whole32(1..=MAX_COUNT))
            .unwrap_or(d.passes),
        spp: t.may("spp", |v| v.whole32(1..=MAX_COUNT)).unwrap_or(d.spp),
        direct: t.may("direct", |v| v.word(&directs)).unwrap_or(d.direct),
        march: t.may("march", march).unwrap_or(d.march),
        kernel: t.may("kernel", |v| v.word(&kernels)).unwrap_or(d.kernel),
        neighbours: t
            .may("neighbours", |v| v.whole32(1..=MAX_COUNT))
            .unwrap_or(d.neighbours),
        search: t.may("search", |v| v.word(&searches)).unwrap_or(d.search),
        exposure: t.may("exposure", |v| v.number(stops)).unwrap_or(d.exposure),
        seed: t.may("seed", |v| v.whole(0..=u64::MAX)).unwrap_or(d.seed),
        crop: None,
        pruning: true,
    }
}

fn march(v: &Item<'_>) -> Option<March> {
    v.choice(&[("exact", March::Exact)], &["step"], |_, v| {
        v.number(ABOVE_0).map(March::Step)
    })
}

/// `[[volume]]`
///
/// | key | unit | default | range |
/// |---|---|---|---|
/// | `file`: .vdb; `####` or `%04d` stand for the frame | | needed | |
/// | `density`: grid name | | `"density"`, else the only float grid | |
/// | `extinction`, `albedo`, `phase` | | see `optics` | |
/// | `emission` | | none | see `emission` |
/// | `transform`: after the file's own | | none | see `transform` |
/// | `convert = "level_set"`: fill a level set with fog | | a level set is an error | |
/// | `strict`: refuse values that are negative or not finite, rather than clean them | | false | |
fn volume(t: &Keys<'_>) -> Option<Volume> {
    let file = t.need("file", |v| {
        let path = v.path()?;
        if crate::frames::is_pattern(&path) {
            Some(path)
        } else {
            v.file()
        }
    });
    let density = t.may("density", Item::string).map(str::to_owned);
    let optics = optics(t);
    let emission = t.may("emission", emission);
    let transform = t.may("transform", |v| v.table(transform));
    let convert = t.may("convert", |v| v.word(&[("level_set", Convert::LevelSet)]));
    let strict = t.may("strict", Item::flag);
    Some(Volume {
        file: file?,
        density,
        optics: optics?,
        emission,
        transform: transform.unwrap_or_default(),
        convert: convert.unwrap_or(Convert::None),
        strict: strict.unwrap_or(false),
    })
}

/// Keys of every medium: in `[[volume]]`, `[[fog]]` and the `interior` of an object.
///
/// | key | unit | default | range |
/// |---|---|---|---|
/// | `extinction`: colour, where the density is 1 | 1/m | needed | 0 or more |
/// | `albedo`: colour, scattered share of the extinction | | needed | 0 to 1 |
/// | `phase` | | `"isotropic"` | `"isotropic"`, `"rayleigh"`, `{ henyey_greenstein = { g } }` |
/// | `g`: mean cosine, forward above 0 | | needed | -1 to 1, excluded |
fn optics(t: &Keys<'_>) -> Option<Optics> {
    let extinction = t.need("extinction", |v| v.colour(FROM_0));
    let albedo = t.need("albedo", |v| v.colour(SHARE));
    let phase = t.may("phase", phase).unwrap_or(Phase::Isotropic);
    Some(Optics {
        extinction: extinction?,
        albedo: albedo?,
        phase,
    })
}

fn phase(v: &Item<'_>) -> Option<Phase> {
    let words = [
        ("isotropic", Phase::Isotropic),
        ("rayleigh", Phase::Rayleigh),
    ];
    // The bound holds for the f32 it becomes, too.
    let asymmetry = Limits(|g| (g as f32).abs() < 1.0, "above -1 and below 1");
    v.choice(&words, &["henyey_greenstein"], |_, v| {
        v.table(|t| {
            t.need("g", |v| v.number(asymmetry))
                .map(|g| Phase::HenyeyGreenstein(g as f32))
        })
    })
}

/// `emission = { blackbody = { .. } }`
///
/// | key | unit | default | range |
/// |---|---|---|---|
/// | `temperature`: grid name | | `"temperature"` | |
/// | `scale`: temperature where the grid is 1 | K | 1 | above 0 |
/// | `radiance`: factor | | 1 | 0 or more |
fn emission(v: &Item<'_>) -> Option<Emission> {
    v.tagged(&["blackbody"], |_, v| {
        v.table(|t| {
            Some(Emission::Blackbody {
                temperature: t
                    .may("temperature", Item::string)
                    .unwrap_or("temperature")
                    .to_owned(),
                scale: t.may("scale", |v| v.number(ABOVE_0)).unwrap_or(1.0),
                radiance: t.may("radiance", |v| v.number(FROM_0)).unwrap_or(1.0),
            })
        })
    })
}

/// `transform = { .. }`: scaled, then rotated about x, then y, then z, then translated.
///
/// | key | unit | default | range |
/// |---|---|---|---|
/// | `scale`: number or `[x, y, z]` | | 1 | not 0; below 0 mirrors |
/// | `rotate`: `[x, y, z]` | degrees | 0 | |
/// | `translate`: `[x, y, z]` | m | 0 | |
fn transform(t: &Keys<'_>) -> Option<DAffine3> {
    let translate = t.may("translate", Item::point).unwrap_or(DVec3::ZERO);
    let rotate = t.may("rotate", Item::point).unwrap_or(DVec3::ZERO);
    let not_0 = Limits(|v| v != 0.0, "other than 0");
    let scale = t.may("scale", |v| {
        if v.is_list() {
            let list = v.list("a number or [x, y, z]", |v| v.number(not_0));
            list.map(DVec3::from_array)
        } else {
            v.number(not_0).map(DVec3::splat)
        }
    });
    let r = rotate.map(f64::to_radians);
    let turn =
        DMat3::from_rotation_z(r.z) * DMat3::from_rotation_y(r.y) * DMat3::from_rotation_x(r.x);
    Some(DAffine3::from_mat3_translation(
        turn * DMat3::from_diagonal(scale.unwrap_or(DVec3::ONE)),
        translate,
    ))
}

/// `[[fog]]`: a medium of density 1.
///
/// | key | unit | default | range |
/// |---|---|---|---|
/// | `box = { min, max }`: what it fills | m | everything | min below max |
/// | `extinction`, `albedo`, `phase` | | see `optics` | |
fn fog(t: &Keys<'_>) -> Option<Fog> {
    let bounds = t.may("box", |v| v.table(corners));
    let optics = optics(t);
    Some(Fog {
        bounds,
        optics: optics?,
    })
}

/// `{ min, max }` \[m\], min below max along every axis.
fn corners(t: &Keys<'_>) -> Option<[DVec3; 2]> {
    let (min, max) = (t.need("min", Item::point), t.need("max", Item::point));
    let (min, max) = (min?, max?);
    if min.cmplt(max).all() {
        return Some([min, max]);
    }
    let message = "`max` has to lie above `min` along every axis";
    t.faults.note(t.span_of("max"), message);
    None
}

/// `corner`, `edge_u`, `edge_v` \[m\], the edges not parallel.
fn quad(t: &Keys<'_>) -> Option<[DVec3; 3]> {
    let corner = t.need("corner", Item::point);
    let edge_u = t.need("edge_u", Item::direction);
    let edge_v = t.need("edge_v", Item::direction);
    let (u, v) = (edge_u?, edge_v?);
    if u.normalize().cross(v.normalize()).length() < 1e-6 {
        let message = "`edge_v` is parallel to `edge_u`; they have to span an area";
        t.faults.note(t.span_of("edge_v"), message);
        return None;
    }
    Some([corner?, u, v])
}

/// `center` \[m\], `radius` \[m\] above 0.
fn ball(t: &Keys<'_>) -> Option<(DVec3, f64)> {
    let center = t.need("center", Item::point);
    let radius = t.need("radius", |v| v.number(ABOVE_0));
    Some((center?, radius?))
}

/// The settings as a `[render]` section, for pictures to say how they were made.
pub fn settings_text(s: &Settings) -> String {
    let direct = match s.direct {
        Direct::Sampled => "sampled",
        Direct::Photons => "photons",
    };
    let march = match s.march {
        March::Exact => "\"exact\"".to_owned(),
        March::Step(step) => format!("{{ step = {step:?} }}"),
    };
    let kernel = match s.kernel {
        Kernel::Constant => "constant",
        Kernel::Biweight => "biweight",
        Kernel::Epanechnikov => "epanechnikov",
    };
    let search = match s.search {
        Search::Nearest => "nearest",
        Search::Radius => "radius",
    };
    format!(
        "[render]\nmethod = \"{}\"\nmax_bounces = {}\nphotons = {}\npasses = {}\nspp = {}\n\
         direct = \"{direct}\"\nmarch = {march}\nkernel = \"{kernel}\"\nneighbours = {}\n\
         search = \"{search}\"\nexposure = {:?}\nseed = {}\n# crop = {:?}, pruning = {}\n",
        s.method.name(),
        s.max_bounces,
        s.photons,
        s.passes,
        s.spp,
        s.neighbours,
        s.exposure,
        s.seed,
        s.crop,
        s.pruning,
    )
}
