//! The map of a synthetic truth (G5): what the nine pairs make of ground that is known, with errors of
//! calibration and sagging legs.

use terrain::synthetic::Recipe;

use crate::campaign::{Campaign, Errors, gather, map_of, score};

/// Standard deviations of doubt that the classes take into account.
const K: f64 = 0.5;

/// Judges a campaign against the gate; `rmse` is what heights within 4 m of a camera may be off (m).
fn judge(label: &str, campaign: &Campaign, rmse: f64) {
    let gathered = gather(campaign);
    let mapper = map_of(&gathered);
    let plain = score(&gathered, mapper.version(), 0.0);
    let cautious = score(&gathered, mapper.version(), K);
    println!("{label}\n  as it looks: {plain}\n  with doubt: {cautious}");
    assert!(cautious.visible > 20_000.0 && cautious.truly_unsafe > 0.01 * cautious.visible);
    assert!(cautious.classed > 0.7 * cautious.visible, "{label}: most of it is known");
    assert!(
        cautious.safe > 0.1 * cautious.visible,
        "{label}: a map that calls nothing safe is none"
    );
    assert!(cautious.unsafe_called_safe <= 0.005 * cautious.visible, "{label}: {cautious}");
    assert!(cautious.rmse_4m <= rmse, "{label}: {}", cautious.rmse_4m);
    assert!((0.8..=1.3).contains(&cautious.normalized_4m), "{label}: {}", cautious.normalized_4m);
}

#[test]
fn unsafe_ground_is_hardly_ever_called_safe() {
    if !std::env::var("FOOTFALL_FULL").is_ok_and(|v| v == "1") {
        // Half the pixels: what errors of calibration leave of 2 cm is for whole images.
        let short = Campaign { size_px: [512, 384], ..Campaign::of(Recipe::boulder_field(), 1) };
        return judge("boulder_field 1, half size", &short, 0.025);
    }
    for name in Recipe::NAMES {
        let recipe = Recipe::from_name(name).unwrap();
        for (label, errors) in [("as calibrated", Errors::NONE), ("with errors", Errors::usual())] {
            let campaign = Campaign { errors, ..Campaign::of(recipe, 2) };
            judge(&format!("{name} 2, {label}"), &campaign, 0.02);
        }
    }
}
