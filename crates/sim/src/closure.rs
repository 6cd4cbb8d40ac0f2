//! Where the base is while several legs move over wheels that stand.
//!
//! Base and ground are joined by all standing legs at once: a closed chain. A braked wheel's pose is
//! to stay where it was; of a wheel that its drive holds, center and axle are. Joint-linear motion between knots bends the chain a little; the
//! rover then takes the base pose that fits best, and what is left is *slip* of the wheels.
//!
//! The fit is the rigid motion T = (R, t) that minimizes Σ |T c - c'|² + r² |R A - A'|²/2 over the
//! wheels: c is the center, A the orientation as a matrix, r the radius, primes where it stood.
//! For a small turn by an angle, |R A - A'|²/2 is its square: turning a wheel counts as the length
//! that its rim slips. A wheel held by its drive has |R a - a'|² with its axle a instead: turns about
//! the axle are free. All parts are linear in R, so one singular value decomposition solves it
//! (Kabsch 1976).

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};

use crate::command::WheelHold;

/// Largest slip of a standing wheel for a robot of scale 1 (m); plans keep to 2 mm.
const SLIP_MAX: f64 = 0.005;

/// The largest slip that is taken for closed (m).
pub(crate) fn slip_max(robot: &Robot) -> f64 {
    SLIP_MAX * robot.scale()
}

/// The wheels that stand, and where.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Closure {
    anchors: Vec<(LegId, Isometry3<f64>)>,
    hold: WheelHold,
}

/// Standing wheels as well as they can be with some joint angles.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fit {
    /// Best pose of the base, and the angles.
    pub configuration: Configuration,
    /// All links there.
    pub posture: Posture,
    /// The wheel that slips most.
    pub leg: LegId,
    /// By how much (m): its center or, by turning, its rim.
    pub slip: f64,
}

impl Closure {
    /// The wheels of `standing` stay where they are in `posture`. There must be one.
    pub fn new(robot: &Robot, posture: &Posture, standing: &[LegId], hold: WheelHold) -> Closure {
        let anchor = |leg: &LegId| (*leg, posture.wheel(robot, *leg).world_from_wheel);
        Closure { anchors: standing.iter().map(anchor).collect(), hold }
    }

    /// The legs that stand.
    pub fn legs(&self) -> impl Iterator<Item = LegId> {
        self.anchors.iter().map(|(leg, _)| *leg)
    }

    /// The base pose with all legs at these angles (rad).
    pub fn fit(&self, robot: &Robot, legs: Vec<LegAngles>) -> Fit {
        let mut configuration = Configuration { world_from_base: Isometry3::identity(), legs };
        let from_base = Posture::new(robot, &configuration);
        let wheels: Vec<Pair> = self
            .anchors
            .iter()
            .map(|(leg, stood)| {
                let wheel = from_base.wheel(robot, *leg);
                Pair { wheel: wheel.world_from_wheel, stood: *stood, radius: wheel.radius }
            })
            .collect();
        configuration.world_from_base = best_fit(&wheels, self.hold);
        let base = configuration.world_from_base;
        let slips = self.legs().zip(&wheels).map(|(leg, Pair { wheel, stood, radius })| {
            let now = base * wheel;
            let center = (now.translation.vector - stood.translation.vector).norm();
            let turn = match self.hold {
                WheelHold::Brakes => now.rotation.angle_to(&stood.rotation),
                WheelHold::Drives => axle(&now).angle(&axle(stood)),
            };
            (leg, center.max(radius * turn))
        });
        let (leg, slip) = slips.fold(
            (LegId(0), 0.0),
            |worst: (LegId, f64), next| {
                if next.1 > worst.1 { next } else { worst }
            },
        );
        Fit { posture: Posture::new(robot, &configuration), configuration, leg, slip }
    }
}

/// One wheel of a fit.
struct Pair {
    /// Its pose from the base.
    wheel: Isometry3<f64>,
    /// Its pose in `world` where it stands.
    stood: Isometry3<f64>,
    /// Its radius (m).
    radius: f64,
}

/// The rigid motion that takes the wheels best to where they stand; see the head of this file.
fn best_fit(pairs: &[Pair], hold: WheelHold) -> Isometry3<f64> {
    let n = pairs.len().max(1) as f64;
    let middle = |of: fn(&Pair) -> &Isometry3<f64>| {
        pairs.iter().map(|pair| of(pair).translation.vector).sum::<Vector3<f64>>() / n
    };
    let (from, to) = (middle(|pair| &pair.wheel), middle(|pair| &pair.stood));
    let mut correlation = Matrix3::zeros();
    for Pair { wheel, stood, radius } in pairs {
        let (a, b) = (wheel.translation.vector - from, stood.translation.vector - to);
        let turn = match hold {
            WheelHold::Brakes => {
                let turn = stood.rotation * wheel.rotation.inverse();
                turn.to_rotation_matrix().into_inner() * 0.5
            }
            WheelHold::Drives => axle(stood) * axle(wheel).transpose(),
        };
        correlation += b * a.transpose() + turn * (radius * radius);
    }
    let rotation = nearest_rotation(&correlation);
    Isometry3::from_parts((to - rotation * from).into(), rotation)
}

/// The direction of a wheel's axle.
fn axle(wheel: &Isometry3<f64>) -> Vector3<f64> {
    wheel.rotation * Vector3::y()
}

/// The rotation R with the largest trace of Rᵀ `correlation`.
fn nearest_rotation(correlation: &Matrix3<f64>) -> UnitQuaternion<f64> {
    let svd = correlation.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return UnitQuaternion::identity() };
    // A mirror image fits better now and then; the least singular value pays for turning it back.
    let mirrored = (u * v_t).determinant() < 0.0;
    let mut signs = Vector3::repeat(1.0);
    if mirrored {
        signs[svd.singular_values.imin()] = -1.0;
    }
    let rotation = u * Matrix3::from_diagonal(&signs) * v_t;
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64, y: f64, z: f64, turn: [f64; 3]) -> Isometry3<f64> {
        Isometry3::new(Vector3::new(x, y, z), turn.into())
    }

    fn pair(wheel: Isometry3<f64>, stood: Isometry3<f64>) -> Pair {
        Pair { wheel, stood, radius: 0.26 }
    }

    fn wheels() -> Vec<Isometry3<f64>> {
        let place = |k: u32| 1.047 * f64::from(k);
        (0..6)
            .map(|k| pose(2.0 * place(k).cos(), 2.0 * place(k).sin(), 0.1, [0.2, place(k), 1.0]))
            .collect()
    }

    #[test]
    fn a_rigid_motion_is_found_whatever_it_is() {
        for motion in [pose(0.0, 0.0, 0.0, [0.0; 3]), pose(1.0, -2.0, 3.0, [0.3, 1.4, -2.0])] {
            for n in [1, 3, 6] {
                let pairs: Vec<_> =
                    wheels()[..n].iter().map(|wheel| pair(*wheel, motion * wheel)).collect();
                let found = best_fit(&pairs, WheelHold::Brakes);
                assert!((found.inverse() * motion).translation.vector.norm() < 1e-9);
                assert!(found.rotation.angle_to(&motion.rotation) < 1e-9);
            }
        }
    }

    #[test]
    fn wheels_held_by_their_drives_may_have_turned_about_their_axles() {
        let motion = pose(1.0, -2.0, 3.0, [0.3, 1.4, -2.0]);
        let pitched = |(i, w): (usize, &Isometry3<f64>)| {
            pair(w * pose(0.0, 0.0, 0.0, [0.0, 0.4 * (i as f64 - 2.0), 0.0]), motion * w)
        };
        for n in [3, 6] {
            let pairs: Vec<_> = wheels()[..n].iter().enumerate().map(pitched).collect();
            let off = |hold| {
                let off = best_fit(&pairs, hold).inverse() * motion;
                off.translation.vector.norm() + off.rotation.angle()
            };
            assert!(off(WheelHold::Drives) < 1e-9);
            assert!(off(WheelHold::Brakes) > 1e-3);
        }
    }

    #[test]
    fn what_does_not_fit_is_shared_so_that_no_small_motion_fits_better() {
        let off = |i: usize| 0.01 * (i as f64 * 2.3).sin();
        let pairs: Vec<_> = wheels()
            .iter()
            .enumerate()
            .map(|(i, w)| pair(*w, w * pose(off(i), off(i + 7), off(i + 3), [off(i + 1); 3])))
            .collect();
        let cost = |motion: &Isometry3<f64>| -> f64 {
            let of = |Pair { wheel, stood, radius }: &Pair| {
                let now = motion * wheel;
                let turned = now.rotation.to_rotation_matrix().into_inner()
                    - stood.rotation.to_rotation_matrix().into_inner();
                (now.translation.vector - stood.translation.vector).norm_squared()
                    + 0.5 * radius * radius * turned.norm_squared()
            };
            pairs.iter().map(of).sum()
        };
        let found = best_fit(&pairs, WheelHold::Brakes);
        let best = cost(&found);
        for k in 0..6 {
            for step in [-1e-4, 1e-4] {
                let mut by = [0.0; 6];
                by[k] = step;
                let near = pose(by[0], by[1], by[2], [by[3], by[4], by[5]]) * found;
                assert!(cost(&near) > best, "{k} {step}");
            }
        }
    }
}
