//! Every file of the corpus and of the published files agrees with what OpenVDB reads from it.

use glam::{DMat4, IVec3};
use serde_json::Value as Json;
use vpm_vdb::vdb::{Archive, Cleaner, GridClass, LevelSetToFog, Statistics, Value, ValueType};

use super::vdb_files::{folder, json, vdb_files};

fn number(v: &Json) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("{v} is a number"))
}

fn triple(v: &Json) -> [f64; 3] {
    [number(&v[0]), number(&v[1]), number(&v[2])]
}

fn ivec3(v: &Json) -> IVec3 {
    IVec3::from(triple(v).map(|v| v as i32))
}

/// Bit for bit; a JSON number is the exact value of a float.
fn same(got: Value, want: &Json) -> bool {
    match got {
        Value::Float(v) => v.to_bits() == (number(want) as f32).to_bits(),
        Value::Double(v) => v.to_bits() == number(want).to_bits(),
        Value::Int(v) => Some(v) == want.as_i64(),
        Value::Bool(v) => Some(v) == want.as_bool(),
        Value::Vec3s(v) => v.map(f32::to_bits) == triple(want).map(|w| (w as f32).to_bits()),
        Value::Vec3d(v) => v.map(f64::to_bits) == triple(want).map(f64::to_bits),
        Value::Vec3i(v) => v.map(f64::from) == triple(want),
    }
}

fn scalar(value: Value) -> Option<f32> {
    Some(match value {
        Value::Float(v) => v,
        Value::Double(v) => v as f32,
        Value::Int(v) => v as f32,
        Value::Bool(v) => f32::from(u8::from(v)),
        _ => return None,
    })
}

/// Everything `read_scalar` says, as a lookup by plain search: the renderer's view of the grid.
fn rendered(archive: &Archive, index: usize, at: &[IVec3]) -> Vec<f32> {
    let grid = archive.read_scalar(index).expect("the grid loads");
    let mut bricks = vec![f32::NAN; 729 * grid.leaf_origins.len()];
    grid.decode_leaves(&mut bricks, 729, |_, values, brick| {
        for (row, values) in values.chunks_exact(8).enumerate() {
            let (x, y) = (row / 8, row % 8);
            brick[81 * x + 9 * y..][..8].copy_from_slice(values);
        }
    })
    .expect("the leaves unpack");
    let leaves: std::collections::HashMap<IVec3, usize> = grid
        .leaf_origins
        .iter()
        .enumerate()
        .map(|(i, &o)| (o, i))
        .collect();
    assert_eq!(leaves.len(), grid.leaf_origins.len(), "origins are unique");
    at.iter()
        .map(|&ijk| {
            if let Some(&leaf) = leaves.get(&(ijk & !7)) {
                let p = ijk & 7;
                return bricks[729 * leaf + (81 * p.x + 9 * p.y + p.z) as usize];
            }
            let tile = grid
                .tiles
                .iter()
                .find(|t| ijk & !((1 << t.log2_size) - 1) == t.origin);
            tile.map_or(grid.background, |t| t.value)
        })
        .collect()
}

fn close(a: f64, b: f64, relative: f64, scale: f64) -> bool {
    (a - b).abs() <= relative * b.abs().max(scale)
}

fn assert_matrix(got: DMat4, want: DMat4, what: &str) {
    let scale = want
        .to_cols_array()
        .iter()
        .fold(0.0f64, |m, v| m.max(v.abs()));
    for (g, w) in got.to_cols_array().into_iter().zip(want.to_cols_array()) {
        // OpenVDB's figures are differences of mapped points, so they carry its rounding.
        assert!(
            close(g, w, 1e-12, scale),
            "{what}: transform {got} is not {want}"
        );
    }
}

fn check_range(stats: &Statistics, min: &Json, max: &Json, what: &str) {
    let list = |v: &Json| match v {
        Json::Array(a) => a.iter().map(number).collect(),
        Json::Bool(b) => vec![f64::from(u8::from(*b))],
        v => vec![number(v)],
    };
    let (min, max) = (list(min), list(max));
    let first = stats.components[0];
    assert_eq!(
        (first.min, first.max),
        (min[0], max[0]),
        "{what}: range of the active values"
    );
    // OpenVDB orders vectors by their first component; the others of its two lie in our ranges.
    for (c, (&a, &b)) in stats.components.iter().zip(min.iter().zip(&max)) {
        let range = c.min..=c.max;
        assert!(
            range.contains(&a) && range.contains(&b),
            "{what}: {a}, {b} not in {range:?}"
        );
    }
}

#[test]
fn corpus_agrees_with_openvdb() {
    let Some(folder) = folder("corpus") else {
        return;
    };
    let (mut files, mut grids, mut probes, mut refused) = (0, 0, 0, Vec::new());
    for path in vdb_files(&folder) {
        let side = json(&path.with_extension("json"));
        let archive = Archive::open(&path).unwrap();
        let expected = side["grids"].as_array().unwrap();
        assert_eq!(archive.grids().len(), expected.len(), "{}", path.display());
        assert_eq!(
            Some(u64::from(archive.version().format)),
            side["file_version"].as_u64()
        );
        assert_eq!(
            Some(!archive.version().streamed),
            side["has_grid_offsets"].as_bool()
        );
        files += 1;
        for want in expected {
            let unique = want["unique_name"].as_str().unwrap();
            let what = format!("{} `{unique}`", path.display());
            let index = archive.grids().iter().position(|g| g.unique_name == unique);
            let index = index.unwrap_or_else(|| panic!("{what}: not found"));
            let header = &archive.grids()[index];
            assert_eq!(header.name, want["name"].as_str().unwrap(), "{what}: name");
            assert_eq!(
                header.value_type.name(),
                want["type"].as_str().unwrap(),
                "{what}: type"
            );
            assert_eq!(
                header.instance_of.as_deref().unwrap_or_default(),
                want["instance_parent"].as_str().unwrap(),
                "{what}: instance"
            );
            assert_eq!(
                header.half,
                want["saved_as_half"].as_bool().unwrap(),
                "{what}: half"
            );
            if header.value_type == ValueType::Points {
                let e = archive.read_scalar(index).unwrap_err().to_string();
                assert!(e.contains("points") && e.contains(&header.name), "{e}");
                refused.push(what);
                continue;
            }
            assert_eq!(
                header.class.name(),
                want["class"].as_str().unwrap(),
                "{what}: class"
            );
            assert_eq!(header.map, want["map"].as_str().unwrap(), "{what}: map");
            // OpenVDB does not tell that of a streamed file.
            if let Some(bits) = want["compression"].as_u64() {
                assert_eq!(
                    u64::from(header.compression.bits()),
                    bits,
                    "{what}: compression"
                );
            }

            let stats = archive.statistics(index).unwrap();
            assert!(
                same(stats.background, &want["background"]),
                "{what}: background"
            );
            assert_eq!(
                Some(stats.active_voxels),
                want["active_voxel_count"].as_u64(),
                "{what}"
            );
            assert_eq!(
                Some(stats.leaves as u64),
                want["leaf_count"].as_u64(),
                "{what}: leaves"
            );
            match stats.bbox {
                None => assert!(want["active_bbox"].is_null(), "{what}: box"),
                Some([low, high]) => {
                    assert_eq!(low, ivec3(&want["active_bbox"][0]), "{what}: box");
                    assert_eq!(high, ivec3(&want["active_bbox"][1]), "{what}: box");
                    // The mask's active tiles have the value false; OpenVDB's range leaves them out.
                    if header.value_type != ValueType::Mask {
                        check_range(&stats, &want["active_min"], &want["active_max"], &what);
                    }
                }
            }

            let list = want["probes"].as_array().unwrap();
            let at: Vec<IVec3> = list.iter().map(ivec3).collect();
            let got = archive.probe(index, &at).unwrap();
            for (got, want) in got.iter().zip(list) {
                assert!(same(got.value, &want[3]), "{what}: {want}, got {got:?}");
                let kind = want[4].as_str().unwrap();
                assert_eq!(
                    got.active,
                    kind.ends_with("_on"),
                    "{what}: {want}, got {got:?}"
                );
            }
            probes += list.len();
            grids += 1;

            match want["index_to_world"].as_array() {
                Some(rows) => {
                    // For row vectors: the rows of the JSON are the columns of glam's matrix.
                    let flat: Vec<f64> = rows
                        .iter()
                        .flat_map(|r| r.as_array().unwrap())
                        .map(number)
                        .collect();
                    let want = DMat4::from_cols_slice(&flat);
                    assert_matrix(header.index_to_world.unwrap(), want, &what);
                }
                None => {
                    let e = archive.read_scalar(index).unwrap_err().to_string();
                    assert!(e.contains("frustum") && e.contains(&header.name), "{e}");
                    refused.push(what);
                    continue;
                }
            }
            if header.value_type.is_scalar() {
                for ((got, view), ijk) in got.iter().zip(rendered(&archive, index, &at)).zip(&at) {
                    let got = scalar(got.value).unwrap();
                    assert_eq!(got.to_bits(), view.to_bits(), "{what}: {ijk} as rendered");
                }
            }
        }
    }
    println!("{files} files, {grids} grids, {probes} probes agree; refused: {refused:#?}");
    assert_eq!((files, refused.len()), (121, 4), "files and refused grids");
}

#[test]
fn published_files_agree_with_openvdb() {
    let Some(folder) = folder("real") else { return };
    let (mut files, mut grids, mut probes) = (0, 0, 0);
    for path in vdb_files(&folder) {
        let side = json(&path.with_extension("expected.json"));
        let printed = side["source"] == "vdb_print";
        let archive = Archive::open(&path).unwrap();
        files += 1;
        let mut seen = std::collections::HashMap::new();
        for want in side["grids"].as_array().unwrap() {
            let name = want["name"].as_str().unwrap();
            let what = format!("{} `{name}`", path.display());
            let ordinal = seen.entry(name).or_insert(0);
            let found = archive.find(&format!("{name}[{ordinal}]")).unwrap();
            *ordinal += 1;
            let header = &archive.grids()[found.index];
            if header.value_type == ValueType::Points {
                let e = archive.read_scalar(found.index).unwrap_err().to_string();
                assert!(e.contains("points"), "{e}");
                continue;
            }
            assert_eq!(
                header.value_type.name(),
                want["type"].as_str().unwrap(),
                "{what}"
            );
            grids += 1;
            let rows = want["index_to_world"].as_array().unwrap();
            let flat: Vec<f64> = rows
                .iter()
                .flat_map(|r| r.as_array().unwrap())
                .map(number)
                .collect();
            let matrix = DMat4::from_cols_slice(&flat).transpose();
            if printed {
                // Three digits are printed.
                let got = header.index_to_world.unwrap().to_cols_array();
                for (g, w) in got.into_iter().zip(matrix.to_cols_array()) {
                    assert!(close(g, w, 5e-3, 0.0), "{what}: {g} is not {w}");
                }
            } else {
                assert_matrix(header.index_to_world.unwrap(), matrix, &what);
            }

            let stats = archive.statistics(found.index).unwrap();
            let active = want["active_voxels"].as_u64().unwrap();
            assert_eq!(stats.active_voxels, active, "{what}");
            if active > 0 {
                let [low, high] = stats.bbox.unwrap();
                assert_eq!(low, ivec3(&want["bbox_min"]), "{what}: box");
                assert_eq!(high, ivec3(&want["bbox_max"]), "{what}: box");
            }
            if want["background"].is_string() {
                assert_eq!(want["background"], "[0, 0, 0]");
                assert_eq!(
                    stats.background,
                    Value::Vec3s([0.0; 3]),
                    "{what}: background"
                );
            } else if header.value_type == ValueType::Int32 {
                assert_eq!(
                    stats.background,
                    Value::Int(number(&want["background"]) as i64)
                );
            } else {
                assert!(
                    same(stats.background, &want["background"]),
                    "{what}: background"
                );
            }
            if let (Some(min), Some(max)) = (want["min"].as_f64(), want["max"].as_f64()) {
                let got = stats.components[0];
                if printed {
                    assert!(close(got.min, min, 1e-5, 0.0), "{what}: {got:?}, {min}");
                    assert!(close(got.max, max, 1e-5, 0.0), "{what}: {got:?}, {max}");
                } else {
                    assert_eq!((got.min, got.max), (min, max), "{what}");
                    assert_eq!(Some(stats.not_finite), want["nonfinite"].as_u64(), "{what}");
                    let (mean, std) = (number(&want["mean"]), number(&want["std"]));
                    assert!(
                        close(got.mean, mean, 1e-9, std),
                        "{what}: {got:?}, mean {mean}"
                    );
                    assert!(
                        close(got.std, std, 1e-7, 1e-12),
                        "{what}: {got:?}, std {std}"
                    );
                }
            }
            let Some(list) = want["probes"].as_array() else {
                continue;
            };
            let at: Vec<IVec3> = list.iter().map(|p| ivec3(&p["ijk"])).collect();
            let got = archive.probe(found.index, &at).unwrap();
            for (got, want) in got.iter().zip(list) {
                assert!(
                    same(got.value, &want["value"]),
                    "{what}: {want}, got {got:?}"
                );
            }
            if header.value_type.is_scalar() {
                for (got, view) in got.iter().zip(rendered(&archive, found.index, &at)) {
                    assert_eq!(
                        scalar(got.value).unwrap().to_bits(),
                        view.to_bits(),
                        "{what}"
                    );
                }
            }
            probes += list.len();
        }
    }
    println!("{files} files, {grids} grids, {probes} probes agree");
    assert_eq!(files, 25, "files of the folder");
}

#[test]
fn unfit_densities_are_counted_and_cleaned() {
    let Some(folder) = folder("real") else { return };
    let archive = Archive::open(&folder.join("negative_values_scivis.vdb")).unwrap();
    let grid = archive.read_scalar(0).unwrap();
    let cleaner = Cleaner::new();
    let mut out = vec![0.0; 512 * grid.leaf_origins.len()];
    grid.decode_leaves(&mut out, 512, |_, v, out| {
        out.copy_from_slice(v);
        cleaner.clean(out);
    })
    .unwrap();
    let stats = archive.statistics(0).unwrap();
    assert_eq!(
        (cleaner.not_finite(), cleaner.negative()),
        (stats.not_finite, stats.negative)
    );
    assert_eq!(cleaner.not_finite(), 1);
    assert!(cleaner.negative() > 0, "the file has negative values");
    assert!(
        out.iter().all(|v| v.is_finite() && *v >= 0.0),
        "all are densities"
    );
}

#[test]
fn level_sets_become_fog_with_their_interior() {
    let Some(folder) = folder("corpus") else {
        return;
    };
    let archive = Archive::open(&folder.join("level_set.o10.vdb")).unwrap();
    let mut grid = archive.read_scalar(0).unwrap();
    assert_eq!(grid.class, GridClass::LevelSet);
    let to_fog = LevelSetToFog::new(&grid).expect("the background is the half width");
    let [low, high] = archive.statistics(0).unwrap().bbox.unwrap();
    let center = (low + high) / 2;
    to_fog.convert(&mut grid);
    let mut out = vec![0.0; 512 * grid.leaf_origins.len()];
    grid.decode_leaves(&mut out, 512, |_, v, out| {
        for (out, &v) in out.iter_mut().zip(v) {
            *out = to_fog.density(v);
        }
    })
    .unwrap();
    assert!(
        out.iter().all(|v| (0.0..=1.0).contains(v)),
        "densities from 0 to 1"
    );
    assert!(
        out.contains(&0.0) && out.contains(&1.0),
        "outside and inside"
    );
    assert_eq!(grid.background, 0.0);
    assert!(
        grid.tiles.iter().all(|t| t.active && t.value == 1.0),
        "only the interior"
    );
    let inside = grid
        .tiles
        .iter()
        .any(|t| center & !((1 << t.log2_size) - 1) == t.origin)
        || grid.leaf_origins.contains(&(center & !7));
    assert!(inside, "the centre {center} is covered");
}
