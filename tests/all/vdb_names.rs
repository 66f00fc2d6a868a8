//! Grids by name: repeated, empty, unicode and missing ones.

use vpm_vdb::info::{InfoOptions, run};
use vpm_vdb::vdb::{Archive, Found};

use super::vdb_files::folder;

fn open(file: &str) -> Option<Archive> {
    folder("corpus").map(|folder| Archive::open(&folder.join(file)).expect("the file opens"))
}

#[test]
fn equal_names_are_told_apart_by_number() {
    let Some(archive) = open("names_equal.o10.vdb") else {
        return;
    };
    assert_eq!(
        archive.find("density").unwrap(),
        Found {
            index: 0,
            same_name: 2
        }
    );
    assert_eq!(
        archive.find("density[0]").unwrap(),
        Found {
            index: 0,
            same_name: 2
        }
    );
    assert_eq!(
        archive.find("density[1]").unwrap(),
        Found {
            index: 1,
            same_name: 2
        }
    );
    let e = archive.find("density[2]").unwrap_err().to_string();
    assert!(e.ends_with("it has: density, density[1]"), "{e}");
}

#[test]
fn empty_names_are_found() {
    let Some(archive) = open("names_empty_two.o10.vdb") else {
        return;
    };
    assert_eq!(
        archive.find("").unwrap(),
        Found {
            index: 0,
            same_name: 2
        }
    );
    assert_eq!(
        archive.find("[1]").unwrap(),
        Found {
            index: 1,
            same_name: 2
        }
    );
}

#[test]
fn unicode_names_are_themselves() {
    let Some(archive) = open("name_unicode.o12.vdb") else {
        return;
    };
    for grid in archive.grids() {
        assert!(!grid.name.is_ascii(), "{}", grid.name);
        assert!(archive.find(&grid.name).is_ok(), "{}", grid.name);
    }
}

#[test]
fn a_missing_grid_lists_those_there_are() {
    let Some(folder) = folder("corpus") else {
        return;
    };
    let bytes = std::fs::read(folder.join("multi_grid.o10.vdb")).unwrap();
    let archive = Archive::from_bytes("cloud.vdb", bytes).unwrap();
    let has: Vec<&str> = archive.grids().iter().map(|g| g.name.as_str()).collect();
    assert_eq!(
        archive.find("densty").unwrap_err().to_string(),
        format!("grid `densty` not in cloud.vdb; it has: {}", has.join(", "))
    );
}

#[test]
fn a_vector_grid_is_no_density() {
    let Some(archive) = open("vec3s_cd.o10.vdb") else {
        return;
    };
    let e = archive
        .read_scalar(archive.find("Cd").unwrap().index)
        .unwrap_err()
        .to_string();
    assert!(
        e.ends_with("grid `Cd`: holds vec3s, where a number was asked for"),
        "{e}"
    );
}

#[test]
fn info_says_what_the_file_holds() {
    let Some(folder) = folder("real") else { return };
    let path = folder.join("wdas_cloud_sixteenth.vdb");
    let print = |options: InfoOptions| {
        let mut out = Vec::new();
        let remarks = run(&path, &options, &mut out).unwrap();
        assert!(remarks.is_empty(), "{remarks:?}");
        String::from_utf8(out).unwrap()
    };
    let table = print(InfoOptions::default());
    for part in [
        "density",
        "fog volume",
        "415,642",
        "3.333",
        "1,208 bricks",
        "50% 0.5",
    ] {
        assert!(table.contains(part), "no {part} in\n{table}");
    }
    let json: serde_json::Value = serde_json::from_str(&print(InfoOptions {
        json: true,
        ..InfoOptions::default()
    }))
    .unwrap();
    let grid = &json[0];
    assert_eq!(grid["name"], "density");
    assert_eq!(grid["grid_class"], "fog volume");
    assert_eq!(grid["active_voxels"], 415_642);
    assert_eq!(grid["bbox_max"], serde_json::json!([59, 64, 63]));
    assert_eq!(grid["bricks"], 1208);
    let expected = super::vdb_files::json(&path.with_extension("expected.json"));
    // Row by row, index to world: 10/3 on the diagonal.
    assert_eq!(
        grid["transform"][2][2],
        expected["grids"][0]["index_to_world"][2][2]
    );
    assert_eq!(grid["transform"][0][3], 0.0);
    let options = InfoOptions {
        json: true,
        grid: Some("density".to_owned()),
        at: vec![[20, -4, 1], [4000, 0, 0]],
    };
    assert_eq!(
        serde_json::from_str::<serde_json::Value>(&print(options)).unwrap(),
        serde_json::json!([
            {"ijk": [20, -4, 1], "value": 0.635_530_292_987_823_5},
            {"ijk": [4000, 0, 0], "value": 0.0}
        ])
    );
}

#[test]
fn info_remarks_on_equal_names() {
    let Some(folder) = folder("corpus") else {
        return;
    };
    let options = InfoOptions {
        grid: Some("density".to_owned()),
        ..InfoOptions::default()
    };
    let path = folder.join("names_equal.o10.vdb");
    let remarks = run(&path, &options, &mut Vec::new()).unwrap();
    assert_eq!(
        remarks,
        ["2 grids are named `density`; this is the first, `density[1]` is the second"]
    );
}
