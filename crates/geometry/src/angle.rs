//! Angles in radians.

use std::f64::consts::{PI, TAU};

/// The same direction in (-π, π].
pub fn wrap_to_pi(angle: f64) -> f64 {
    let turned = angle.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

/// The representative of `angle` (rad) modulo 2π that lies in `[lower, upper]`, or `None`.
///
/// `slack` (rad) lets an angle that misses a limit by rounding alone pass; the result is clamped
/// into the limits. Where several representatives fit, the one nearest to zero is returned.
pub fn within_limits(angle: f64, lower: f64, upper: f64, slack: f64) -> Option<f64> {
    let wrapped = wrap_to_pi(angle);
    [wrapped, wrapped - TAU, wrapped + TAU]
        .into_iter()
        .filter(|a| *a >= lower - slack && *a <= upper + slack)
        .min_by(|a, b| a.abs().total_cmp(&b.abs()))
        .map(|a| a.clamp(lower, upper))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_keeps_the_direction() {
        for turns in -3..=3 {
            let wrapped = wrap_to_pi(0.3 + TAU * f64::from(turns));
            assert!((wrapped - 0.3).abs() < 1e-12);
        }
        assert!((wrap_to_pi(-PI) - PI).abs() < 1e-15, "the interval is open below, closed above");
    }

    #[test]
    fn limits_beyond_half_a_turn_are_reached_from_the_other_side() {
        let found = within_limits(-3.0, -1.9, TAU - 2.9, 0.0).unwrap();
        assert!((found - (TAU - 3.0)).abs() < 1e-12);
        assert_eq!(within_limits(2.0, -1.0, 1.0, 1e-9), None);
        assert_eq!(within_limits(1.0 + 1e-12, -1.0, 1.0, 1e-9), Some(1.0));
    }
}
