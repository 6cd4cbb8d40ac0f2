//! The per-cell answer.

use std::sync::atomic::{AtomicUsize, Ordering};

use collision::{
    ContactZone, LegChecker, NoTouchdown, Scene, Touch, Touchdown, Violation, survey, touchdowns,
};
use geometry::{Grid, Raster};
use nalgebra::{Isometry3, Point2, Point3, Translation3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use stability::rule::{self, Check, Preference};

/// Ways to put the wheel down that are looked at in one cell.
const MOST_TOUCHDOWNS: usize = 12;

/// Most cells of one answer.
const MAX_CELLS: usize = 1_000_000;

/// What a cell is for the leg (F45). FootFall's colors: green, red, orange, blue; colliding and
/// unknown are told apart from unreachable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CellClass {
    /// The ground there is unknown.
    Unknown = 0,
    /// No joint angles bring the wheel there (FootFall: red).
    Unreachable = 1,
    /// The rover would not be stable with the leg there (orange).
    Unstable = 2,
    /// The waypoint above it, or above the start, cannot be reached (blue).
    NoLift = 3,
    /// The wheel can stand there (green).
    Reachable = 4,
    /// The leg would touch something or come too near.
    Colliding = 5,
}

/// Why a cell is not reachable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// It is reachable.
    None = 0,
    /// Out of the leg's reach; missing: meters.
    OutOfReach = 1,
    /// A joint would be beyond its limit; missing: radians.
    JointLimit = 2,
    /// Nobody has seen the ground there.
    UnknownGround = 3,
    /// Too little regular or conservative margin; missing: meters.
    Margin = 4,
    /// Would not survive the settlement of a foot; missing: meters.
    Settlement = 5,
    /// Too near to ground or an obstacle; missing: meters.
    EnvironmentCollision = 6,
    /// Too near to another part of the robot; missing: meters.
    SelfCollision = 7,
    /// The waypoint above cannot be reached; missing: meters.
    LiftOutOfReach = 8,
    /// Something is in the way at the waypoint above; missing: meters.
    LiftCollides = 9,
    /// A joint would be overloaded; missing: share of its torque limit.
    Torque = 10,
    /// The ground under the wheel is too uneven; missing: meters.
    Uneven = 11,
    /// The leg cannot be lifted where it stands.
    StartLift = 12,
}

/// What is asked of [`reach`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReachOptions {
    /// Distance between cells (m).
    pub resolution: f64,
    /// Height of the waypoints above start and goal (m) (F46).
    pub lift: f64,
    /// Which loss of support must be survived.
    pub preference: Preference,
    /// Threads to use, 1 or more.
    pub workers: usize,
}

/// The answer for one leg.
#[derive(Debug, Clone, PartialEq)]
pub struct ReachGrid {
    /// What each cell is.
    pub class: Raster<u8>,
    /// Why, as [`Reason`].
    pub reason: Raster<u8>,
    /// How much is missing, in the unit of the reason; NaN where nothing is.
    pub missing: Raster<f32>,
    /// Regular margin with the leg there, just before it takes load (m); NaN where there is none.
    pub margin: Raster<f32>,
}

impl ReachGrid {
    /// Where the cells lie.
    pub fn grid(&self) -> &Grid {
        self.class.grid()
    }
}

#[derive(Clone, Copy)]
struct Cell {
    class: CellClass,
    reason: Reason,
    missing: f32,
    margin: f32,
}

impl Cell {
    fn new(class: CellClass, reason: Reason, missing: f64) -> Cell {
        Cell { class, reason, missing: missing as f32, margin: f32::NAN }
    }
}

/// Where `leg` can stand with the rest of the robot as in `configuration`, for all cells within a
/// circle of the leg's length around its hip (F43).
///
/// `stop` is asked once a row; `None` if it said so, or if the resolution would need more than a
/// million cells or is not a positive number.
pub fn reach(
    scene: &Scene,
    configuration: &Configuration,
    gravity: f64,
    leg: LegId,
    options: &ReachOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<ReachGrid> {
    let look = Look::new(scene, configuration, gravity, leg, options);
    let grid = look.grid()?;
    let next_row = AtomicUsize::new(0);
    let work = || {
        let checker = LegChecker::new(scene, &look.posture, leg, None, None);
        let mut rows = Vec::new();
        loop {
            let iy = next_row.fetch_add(1, Ordering::Relaxed);
            if iy >= grid.ny {
                return Some(rows);
            }
            if stop() {
                return None;
            }
            let row: Vec<Cell> =
                (0..grid.nx).map(|ix| look.cell(&checker, grid.position(ix, iy))).collect();
            rows.push((iy, row));
        }
    };
    let mut rows: Vec<(usize, Vec<Cell>)> = std::thread::scope(|threads| {
        let others: Vec<_> =
            (1..options.workers.clamp(1, 64)).map(|_| threads.spawn(work)).collect();
        let mut rows = work()?;
        for other in others {
            rows.extend(other.join().ok()??);
        }
        Some(rows)
    })?;
    rows.sort_by_key(|(iy, _)| *iy);
    let cells: Vec<Cell> = rows.into_iter().flat_map(|(_, row)| row).collect();
    Some(ReachGrid {
        class: Raster::new(grid, cells.iter().map(|c| c.class as u8).collect())?,
        reason: Raster::new(grid, cells.iter().map(|c| c.reason as u8).collect())?,
        missing: Raster::new(grid, cells.iter().map(|c| c.missing).collect())?,
        margin: Raster::new(grid, cells.iter().map(|c| c.margin).collect())?,
    })
}

/// What all cells share.
struct Look<'a> {
    scene: &'a Scene,
    robot: &'a Robot,
    leg: LegId,
    gravity: f64,
    options: &'a ReachOptions,
    posture: Posture,
    angles: LegAngles,
    standing: Vec<(LegId, Point3<f64>)>,
    can_lift_off: bool,
}

impl<'a> Look<'a> {
    fn new(
        scene: &'a Scene,
        configuration: &Configuration,
        gravity: f64,
        leg: LegId,
        options: &'a ReachOptions,
    ) -> Look<'a> {
        let robot = scene.robot();
        let posture = Posture::new(robot, configuration);
        let seen = survey(scene, &posture);
        let mut standing = seen.contacts(scene, &posture);
        standing.retain(|(other, _)| *other != leg);
        let stands = seen.standing.contains(&leg);
        let angles = configuration.legs[leg.0];
        let mut look = Look {
            scene,
            robot,
            leg,
            gravity,
            options,
            posture,
            angles,
            standing,
            can_lift_off: true,
        };
        if stands {
            let wheel = look.posture.wheel(robot, leg).world_from_wheel;
            look.can_lift_off = look.raised(&wheel, &angles).is_ok();
        }
        look
    }

    fn grid(&self) -> Option<Grid> {
        let resolution = self.options.resolution;
        let model = self.robot.leg(self.leg);
        let reach = model.ik.reach() + model.wheel.radius;
        let hip = self.posture.link(model.links[0]).translation.vector;
        if !(resolution.is_finite() && resolution > 0.0 && hip.iter().all(|v| v.is_finite())) {
            return None;
        }
        let low = |v: f64| ((v - reach) / resolution).floor();
        let high = |v: f64| ((v + reach) / resolution).ceil();
        let n = |v: f64| high(v) - low(v) + 1.0;
        if n(hip.x) * n(hip.y) > MAX_CELLS as f64 {
            return None;
        }
        let origin = Point2::new(low(hip.x) * resolution, low(hip.y) * resolution);
        Some(Grid { origin, resolution, nx: n(hip.x) as usize, ny: n(hip.y) as usize })
    }

    fn cell(&self, checker: &LegChecker, p: Point2<f64>) -> Cell {
        let model = self.robot.leg(self.leg);
        let hip = self.posture.link(model.links[0]).translation.vector;
        let beyond = (p - Point2::new(hip.x, hip.y)).norm() - model.ik.reach();
        if beyond > 0.0 {
            return Cell::new(CellClass::Unreachable, Reason::OutOfReach, beyond);
        }
        let ways =
            touchdowns(self.scene, &self.posture, self.leg, p, &self.angles, MOST_TOUCHDOWNS);
        let ways = match ways {
            Ok(ways) => ways,
            Err(NoTouchdown::UnknownGround) => {
                return Cell::new(CellClass::Unknown, Reason::UnknownGround, f64::NAN);
            }
            Err(NoTouchdown::Uneven { shift }) => {
                return Cell::new(CellClass::Unreachable, Reason::Uneven, shift);
            }
            Err(NoTouchdown::OutOfReach { distance }) => {
                return Cell::new(CellClass::Unreachable, Reason::OutOfReach, distance);
            }
            Err(NoTouchdown::JointLimits { overrun }) => {
                return Cell::new(CellClass::Unreachable, Reason::JointLimit, overrun);
            }
        };
        // The way that gets furthest speaks for the cell.
        let mut best: Option<(u8, Cell)> = None;
        for way in &ways {
            let (rank, cell) = self.way(checker, way);
            if cell.class == CellClass::Reachable {
                return cell;
            }
            if best.is_none_or(|(r, _)| rank > r) {
                best = Some((rank, cell));
            }
        }
        best.map_or(Cell::new(CellClass::Unreachable, Reason::None, f64::NAN), |(_, cell)| cell)
    }

    /// What one way to put the wheel down is worth, and how far it got.
    fn way(&self, checker: &LegChecker, way: &Touchdown) -> (u8, Cell) {
        let posture = self.posture.with_leg(self.robot, self.leg, &way.angles);
        let rules = self.robot.stance();
        let report = rule::assess(self.robot, &posture, &self.standing, self.gravity);
        let verdict = rule::verdict(&report, rules, self.options.preference);
        let margin = report.regular.as_ref().map_or(f32::NAN, |r| r.margin.depth_m as f32);
        let with_margin = |cell: Cell| Cell { margin, ..cell };
        if !verdict.ok {
            let reason = match verdict.check {
                Check::Settlement => Reason::Settlement,
                Check::Support | Check::Regular | Check::Conservative | Check::Friction => {
                    Reason::Margin
                }
            };
            let missing = verdict.shortfall_m.unwrap_or(f64::NAN);
            return (0, with_margin(Cell::new(CellClass::Unstable, reason, missing)));
        }
        let overload = report.torque.worst.ratio.abs() - 1.0;
        if overload > 0.0 {
            return (0, with_margin(Cell::new(CellClass::Unstable, Reason::Torque, overload)));
        }
        let zone = ContactZone {
            contact: way.contact,
            center: way.wheel.center(),
            radius: rules.contact_radius,
            height: rules.contact_height,
            ground_tolerance: rules.ground_tolerance,
        };
        if let Some(violation) = checker.violation(&posture, Some(&zone)) {
            let missing = violation.required - violation.distance;
            let cell = Cell::new(CellClass::Colliding, collision_reason(&violation), missing);
            return (1, with_margin(cell));
        }
        if !self.can_lift_off {
            let cell = Cell::new(CellClass::NoLift, Reason::StartLift, f64::NAN);
            return (2, with_margin(cell));
        }
        match self.raised(&way.wheel.world_from_wheel, &way.angles) {
            Err(missing) => {
                let cell = Cell::new(CellClass::NoLift, Reason::LiftOutOfReach, missing);
                (2, with_margin(cell))
            }
            Ok(angles) => {
                let raised = self.posture.with_leg(self.robot, self.leg, &angles);
                match checker.violation(&raised, None) {
                    Some(violation) => {
                        let missing = violation.required - violation.distance;
                        let cell = Cell::new(CellClass::NoLift, Reason::LiftCollides, missing);
                        (3, with_margin(cell))
                    }
                    None => {
                        let cell = Cell::new(CellClass::Reachable, Reason::None, f64::NAN);
                        (4, with_margin(cell))
                    }
                }
            }
        }
    }

    /// Joint angles at the waypoint above a wheel, on the branch nearest to `near`; the error is
    /// what is missing (m), zero where limits are in the way.
    fn raised(&self, wheel: &Isometry3<f64>, near: &LegAngles) -> Result<LegAngles, f64> {
        let above = Translation3::new(0.0, 0.0, self.options.lift) * wheel;
        let solutions = self
            .posture
            .inverse_kinematics(self.robot, self.leg, &above)
            .map_err(|missed| missed.distance)?;
        solutions
            .iter()
            .filter(|s| s.within_limits)
            .map(|s| s.angles)
            .min_by(|a, b| (a - near).amax().total_cmp(&(b - near).amax()))
            .ok_or(0.0)
    }
}

fn collision_reason(violation: &Violation) -> Reason {
    match violation.touch {
        Touch::Links(..) => Reason::SelfCollision,
        Touch::Ground(_) | Touch::Obstacle(..) => Reason::EnvironmentCollision,
        Touch::UnknownGround(_) => Reason::UnknownGround,
    }
}
