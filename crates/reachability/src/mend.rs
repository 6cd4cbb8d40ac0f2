//! The nearest mends of a cell that is refused: found by trying, so that one is offered only if with it
//! the cell, or its neighbor, is reachable.

use collision::{LegChecker, Scene};
use nalgebra::{Point2, Translation3, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};

use crate::answer::CellClass;
use crate::cell::Searcher;
use crate::look::{Look, seen};

/// Shifts of the body that are tried, as shares of the robot's scale (m).
const SHIFTS: [f64; 6] = [0.02, 0.04, 0.08, 0.12, 0.2, 0.3];
/// Directions of shifts along the ground.
const DIRECTIONS: usize = 8;
/// How far around another cell is looked for, as a share of the robot's scale (m).
const AROUND: f64 = 0.5;
/// Most cells that are looked at for that.
const MOST_CELLS: usize = 2000;

/// Something that would help.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mend {
    /// Shift the body over its planted wheels by this much (`world`, m); upward is standing taller.
    ///
    /// That all planted legs can follow and that nothing then overlaps has been looked at; the way
    /// there has not.
    Shift(Vector3<f64>),
    /// Take this reachable place instead.
    Place {
        /// Where (`world`, m).
        at: Point2<f64>,
        /// How far from the place asked for (m).
        distance: f64,
    },
}

impl Mend {
    /// A clause for people.
    pub(crate) fn text(&self) -> String {
        match self {
            Mend::Shift(by) if by.z > 0.0 => format!("stand {:.2} m taller", by.z),
            Mend::Shift(by) if by.z < 0.0 => format!("stand {:.2} m lower", -by.z),
            Mend::Shift(by) => {
                format!("shift the body by {:.2} m along x and {:.2} m along y", by.x, by.y)
            }
            Mend::Place { at, distance } => {
                format!("take the place {distance:.2} m beside, at {:.2}, {:.2}", at.x, at.y)
            }
        }
    }
}

/// The smallest shift of the body that was found to help, and the nearest place.
pub(crate) fn mends(
    searcher: &mut Searcher,
    look: &Look,
    configuration: &Configuration,
    gravity: f64,
    p: Point2<f64>,
) -> Vec<Mend> {
    let shift = shift(look, configuration, gravity, p).map(Mend::Shift);
    shift.into_iter().chain(place(searcher, look, p)).collect()
}

fn shift(
    look: &Look,
    configuration: &Configuration,
    gravity: f64,
    p: Point2<f64>,
) -> Option<Vector3<f64>> {
    let scale = look.robot.scale();
    // Up and down first: that changes the reach of one leg most, and the margins least.
    let level = (0..DIRECTIONS).map(|k| {
        let yaw = std::f64::consts::TAU * k as f64 / DIRECTIONS as f64;
        Vector3::new(yaw.cos(), yaw.sin(), 0.0)
    });
    let directions: Vec<_> = [Vector3::z(), -Vector3::z()].into_iter().chain(level).collect();
    let shifts = SHIFTS.iter().flat_map(|by| directions.iter().map(move |d| d * (by * scale)));
    shifts.into_iter().find(|by| helps(look, configuration, gravity, p, by))
}

/// Is the cell reachable with the body shifted?
fn helps(
    look: &Look,
    configuration: &Configuration,
    gravity: f64,
    p: Point2<f64>,
    by: &Vector3<f64>,
) -> bool {
    let Some(shifted) = shifted(look, configuration, by) else { return false };
    let (scene, leg): (&Scene, LegId) = (look.scene, look.leg);
    let seen = seen(scene, &shifted);
    let free = seen.self_collision().is_none() && seen.terrain_collision().is_none();
    let stands = |leg: LegId| seen.standing.contains(&leg);
    if !free || !look.standing.iter().all(|(other, _)| stands(*other)) {
        return false;
    }
    let look = Look::new(scene, &shifted, &seen, gravity, leg, look.options);
    let checker = LegChecker::new(scene, &look.posture, leg, None, None);
    Searcher::new(&look, &checker).cell(p, &[]).cell.class == CellClass::Reachable
}

/// The configuration with the body shifted and all wheels that stand where they are; none if a leg
/// cannot follow.
fn shifted(look: &Look, before: &Configuration, by: &Vector3<f64>) -> Option<Configuration> {
    let robot: &Robot = look.robot;
    let mut after = before.clone();
    after.world_from_base = Translation3::from(*by) * before.world_from_base;
    let posture = Posture::new(robot, &after);
    let others = look.standing.iter().map(|(leg, _)| *leg);
    for leg in others.chain(look.stands.then_some(look.leg)) {
        let wheel = look.posture.wheel(robot, leg).world_from_wheel;
        let near = before.legs[leg.0];
        let from = |q: &LegAngles| (q - near).amax();
        let all = posture.inverse_kinematics(robot, leg, &wheel).ok()?;
        let within = all.iter().filter(|s| s.within_limits).map(|s| s.angles);
        after.legs[leg.0] = within.min_by(|a, b| from(a).total_cmp(&from(b)))?;
    }
    Some(after)
}

/// The nearest reachable cell of the grid that the options ask for.
fn place(searcher: &mut Searcher, look: &Look, p: Point2<f64>) -> Option<Mend> {
    let resolution = look.options.resolution;
    if !(resolution.is_finite() && resolution > 0.0) {
        return None;
    }
    let most = AROUND * look.robot.scale();
    // No more than may be looked at, however fine the grid.
    let n = ((most / resolution).ceil().min((MOST_CELLS as f64).sqrt() / 2.0)) as i64;
    let on_grid = |v: f64| (v / resolution).round();
    let (x, y) = (on_grid(p.x), on_grid(p.y));
    let mut around: Vec<(f64, Point2<f64>)> = (-n..=n)
        .flat_map(|iy| (-n..=n).map(move |ix| (ix as f64, iy as f64)))
        .map(|(ix, iy)| Point2::new((x + ix) * resolution, (y + iy) * resolution))
        .map(|at| ((at - p).norm(), at))
        .filter(|(distance, _)| *distance <= most)
        .collect();
    around.sort_by(|a, b| a.0.total_cmp(&b.0));
    let reachable = |at: &Point2<f64>, searcher: &mut Searcher| {
        searcher.cell(*at, &[]).cell.class == CellClass::Reachable
    };
    let (distance, at) = around.into_iter().find(|(_, at)| reachable(at, searcher))?;
    Some(Mend::Place { at, distance })
}
