//! The console's built files are part of the program; without them it says how to build them.

fn main() {
    let dist = concat!(env!("CARGO_MANIFEST_DIR"), "/../../web/dist");
    println!("cargo::rerun-if-changed={dist}");
    println!("cargo::rerun-if-changed=../../config/demo.toml");
    println!("cargo::rerun-if-changed=../../fixtures/robots");
    if let Err(error) = std::fs::create_dir_all(dist) {
        println!("cargo::error=the folder web/dist cannot be made: {error}");
    }
}
