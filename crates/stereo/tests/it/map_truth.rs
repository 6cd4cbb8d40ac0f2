//! The map of a synthetic truth (G5): what the nine pairs make of ground that is known, with errors of
//! calibration and sagging legs.

use terrain::synthetic::Recipe;

use crate::campaign::{Campaign, Errors, gather, map_of, score};

/// Standard deviations of doubt that the classes take into account.
const K: f64 = 0.5;

/// Judges a campaign against the gate, and gives what it fails; `rmse` is what heights within 4 m of a camera may be
/// off (m), `seen` how many cells are to be seen at least, and `bad` the share of them that is to be unsafe.
fn judge(label: &str, campaign: &Campaign, rmse: f64, [seen, bad]: [f64; 2]) -> Vec<String> {
    let gathered = gather(campaign);
    let mapper = map_of(&gathered);
    let plain = score(&gathered, mapper.version(), 0.0);
    let s = score(&gathered, mapper.version(), K);
    println!("{label}\n  as it looks: {plain}\n  with doubt: {s}");
    let held = [
        ("much of it is seen", s.visible > seen),
        ("there is unsafe ground", s.truly_unsafe > bad * s.visible),
        ("most of it is known", s.classed > 0.7 * s.visible),
        // A tenth of all, or of rough highlands, where three in a hundred cells are safe, a part of these.
        (
            "a map that calls nothing safe is none",
            s.safe > (0.1 * s.visible).min(0.14 * s.truly_safe),
        ),
        ("unsafe called safe", s.unsafe_called_safe <= 0.005 * s.visible),
        ("heights within 4 m", s.rmse_4m <= rmse),
        ("errors over sigma", (0.8..=1.3).contains(&s.normalized_4m)),
    ];
    held.iter()
        .filter(|(_, holds)| !holds)
        .map(|(what, _)| format!("{label}: {what}: {s}"))
        .collect()
}

#[test]
fn unsafe_ground_is_hardly_ever_called_safe() {
    let mut failed = Vec::new();
    if std::env::var("FOOTFALL_FULL").is_ok_and(|v| v == "1") {
        for name in Recipe::NAMES {
            let recipe = Recipe::from_name(name).unwrap();
            for (label, errors) in
                [("as calibrated", Errors::NONE), ("with errors", Errors::usual())]
            {
                let campaign = Campaign { errors, ..Campaign::of(recipe, 2) };
                failed.extend(judge(
                    &format!("{name} 2, {label}"),
                    &campaign,
                    0.02,
                    [15_000.0, 0.003],
                ));
            }
        }
    } else {
        // Half the pixels: what errors of calibration leave of 2 cm is for whole images.
        let short = Campaign { size_px: [512, 384], ..Campaign::of(Recipe::boulder_field(), 1) };
        failed.extend(judge("boulder_field 1, half size", &short, 0.025, [20_000.0, 0.01]));
    }
    assert!(failed.is_empty(), "{failed:#?}");
}
