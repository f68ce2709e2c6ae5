//! What fuzzing begins with and what it has found, run again.

#[path = "common/laws.rs"]
mod laws;
#[path = "common/seeds.rs"]
mod seeds;
#[path = "common/mod.rs"]
mod shapes;
#[path = "common/targets.rs"]
mod targets;

use std::fs;
use std::path::Path;

use targets::TARGETS;

#[test]
fn all_that_was_found_is_mended() {
    for (name, target) in TARGETS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus").join(name);
        for entry in fs::read_dir(folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            eprintln!("{}", path.display());
            target(&fs::read(path).unwrap());
        }
    }
}

#[test]
fn every_seed_does_no_harm() {
    let seeds = seeds::seeds();
    for (name, target) in TARGETS {
        let of_target: Vec<_> = seeds.iter().filter(|seed| seed.0 == name).collect();
        assert!(!of_target.is_empty(), "{name}");
        for (i, (_, bytes)) in of_target.into_iter().enumerate() {
            eprintln!("{name} {i}");
            target(bytes);
        }
    }
}

#[test]
#[ignore = "for scripts/fuzz"]
fn write_the_seeds() {
    for (i, (name, bytes)) in seeds::seeds().into_iter().enumerate() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(name);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join(format!("seed-{i:03}")), bytes).unwrap();
    }
}
