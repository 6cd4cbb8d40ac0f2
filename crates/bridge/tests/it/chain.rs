//! The chain of seals: what is changed, lost or exchanged is found.

use bridge::recorder::Storage;
use bridge::verify::verify;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::crash::scenario;
use crate::sim_fs::{SimFs, Survives};

/// Three sessions of several segments each.
fn sealed_logs() -> SimFs {
    let fs = SimFs::default();
    for commands in [50, 6, 70] {
        scenario(&fs, commands);
    }
    fs
}

#[test]
fn sound_logs_have_no_problems_and_a_head() {
    let fs = sealed_logs();
    let found = verify(&fs, None).unwrap();
    assert_eq!((found.problems, found.open, found.lost), (vec![], vec![], vec![]));
    assert_eq!(found.sound, fs.files().len());
    let head = found.head.unwrap();
    assert!(head.log.ends_with("-3"), "{}", head.log);
    let one = verify(&fs, Some(&head.log)).unwrap();
    assert!(one.problems.is_empty() && one.sound < found.sound && one.sound > 1);
}

#[test]
fn any_flipped_bit_of_any_file_is_found() {
    let sound = sealed_logs();
    let files = sound.all_files();
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let cases = if std::env::var_os("FOOTFALL_FULL").is_some() { 5000 } else { 100 };
    for _ in 0..cases {
        let fs = sound.after_crash(Survives::Most);
        let (name, bytes) = files.iter().nth(rng.random_range(0..files.len())).unwrap();
        let (at, bit) = (rng.random_range(0..bytes.len()), rng.random_range(0..8));
        // The newest seal is nobody's predecessor: its own text is vouched for by the head alone.
        let head = verify(&sound, None).unwrap().head;
        let newest = head.as_ref().unwrap();
        let newest = format!("{}/seg-{:06}.seal.json", newest.log, newest.segment);
        let mut changed = bytes.clone();
        changed[at] ^= 1 << bit;
        fs.put(name, changed);
        let found = verify(&fs, None).unwrap();
        if *name == newest {
            assert!(!found.problems.is_empty() || found.head != head, "{name}, byte {at}");
        } else {
            assert!(!found.problems.is_empty(), "{name}, byte {at}, bit {bit}");
        }
    }
}

#[test]
fn any_file_that_is_missing_or_exchanged_is_found() {
    let sound = sealed_logs();
    let head = verify(&sound, None).unwrap().head;
    let files: Vec<String> = sound.all_files().into_keys().collect();
    for name in &files {
        let fs = sound.after_crash(Survives::Most);
        fs.remove(name).unwrap();
        let found = verify(&fs, None).unwrap();
        assert!(!found.problems.is_empty(), "{name} is missing");
    }
    let mut exchanged = 0;
    for (a, b) in files.iter().zip(files.iter().skip(2)) {
        let fs = sound.after_crash(Survives::Most);
        let all = fs.all_files();
        fs.put(a, all[b].clone());
        fs.put(b, all[a].clone());
        assert!(!verify(&fs, None).unwrap().problems.is_empty(), "{a} and {b} exchanged");
        exchanged += 1;
    }
    assert!(exchanged > 5);
    // The newest segment with its seal leaves no trace but the head.
    let fs = sound.after_crash(Survives::Most);
    let newest = head.clone().unwrap();
    let newest = format!("{}/seg-{:06}", newest.log, newest.segment);
    for name in files.iter().filter(|name| name.starts_with(&newest)) {
        fs.remove(name).unwrap();
    }
    let found = verify(&fs, None).unwrap();
    assert!(found.problems.is_empty());
    assert_ne!(found.head, head);
}
