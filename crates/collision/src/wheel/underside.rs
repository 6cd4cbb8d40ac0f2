//! Bounds of a wheel's lower side from below: planes that touch its round, as the wheel lies above them.

use nalgebra::{Point2, Point3, Unit, Vector2, Vector3};

use super::Cylinder;

/// A bound of the wheel's lower side from below, for squares and edges of the grid.
pub(crate) struct Underside {
    center: Point3<f64>,
    /// The lowest point of all (m).
    pub lowest: f64,
    radius: f64,
    /// None for a ball and an upright axle.
    pub level: Option<Level>,
    /// Half of a square's side and of its diagonal (m).
    half_side: f64,
    half_diagonal: f64,
}

/// Directions of a wheel whose axle is not upright.
pub(crate) struct Level {
    /// Level, across the axle.
    aside: Vector2<f64>,
    /// Up, across the axle.
    up: Vector3<f64>,
    /// Level, along the axle, and how far the wheel reaches that way (m).
    along: Vector2<f64>,
    reach: f64,
    /// Rise of the axle along that way, and one over its cosine.
    rise: f64,
    steep: f64,
}

impl Underside {
    pub fn new(wheel: &Cylinder, lowest: f64, side: f64) -> Underside {
        let axle = wheel.axle.into_inner();
        let aside = Unit::try_new(axle.cross(&Vector3::z()), 1e-3).filter(|_| !wheel.ball);
        let level = aside.map(|aside| {
            let along = axle.xy().normalize();
            let cosine = along.dot(&axle.xy());
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            Level {
                aside: aside.xy(),
                up: aside.cross(&axle),
                along,
                reach: wheel.half_width * cosine.abs() + wheel.radius * sine + 1e-9,
                rise: axle.z / cosine,
                steep: 1.0 / cosine,
            }
        });
        Underside {
            center: wheel.center,
            lowest,
            radius: wheel.radius,
            level,
            half_side: 0.5 * side,
            half_diagonal: 0.5 * side * std::f64::consts::SQRT_2,
        }
    }

    /// As [`over_square`](Self::over_square) for a row of squares from `corner` on, of which the heights of
    /// the nodes on both sides are given: by their highest ground and a parabola about the wheel's round,
    /// which is less close, and quicker. Not a number where a height is not.
    pub fn over_row(&self, corner: Point2<f64>, nodes: [&[f32]; 2], bounds: &mut [f64]) {
        let higher = |a: f32, b: f32| if a > b || a.is_nan() { a } else { b };
        let tops = nodes[0].windows(2).zip(nodes[1].windows(2));
        for (top, (near, far)) in bounds.iter_mut().zip(tops) {
            *top = f64::from(higher(higher(near[0], near[1]), higher(far[0], far[1])));
        }
        let Some(level) = &self.level else {
            bounds.iter_mut().for_each(|bound| *bound = self.lowest - *bound);
            return;
        };
        let side = 2.0 * self.half_side;
        let middle = corner - self.center.xy() + Vector2::repeat(self.half_side);
        let (along, aside) = (level.along.dot(&middle), level.aside.dot(&middle));
        let spread = |way: &Vector2<f64>| self.half_side * (way.x.abs() + way.y.abs());
        let (wide, off) = (spread(&level.along), spread(&level.aside));
        let lowest = self.center.z - level.rise.abs() * wide - self.radius * level.steep;
        // A circle lies above the parabola that has its curvature at its lowest point.
        let bend = 0.5 * level.steep / self.radius;
        for (k, bound) in bounds.iter_mut().enumerate() {
            let k = side * f64::from(k as u32);
            let along = along + level.along.x * k;
            let off = (aside + level.aside.x * k).abs() - off;
            let within = if off > 0.0 { off } else { 0.0 };
            let under = lowest + level.rise * along + bend * within * within - *bound;
            let beside = along.abs() - wide > level.reach || off > self.radius;
            *bound = if beside { f64::INFINITY } else { under };
        }
    }

    /// How far aside squares whose ground is nowhere above `top` (m) may have a [bound](Self::over_row) of less
    /// than `gap` (m).
    pub fn aside_of(&self, top: f64, gap: f64) -> f64 {
        let Some(level) = &self.level else { return self.radius };
        let wide = self.half_side * (level.along.x.abs() + level.along.y.abs());
        let lowest = self.center.z
            - level.rise.abs() * (2.0 * wide + level.reach)
            - self.radius * level.steep;
        let spare = (gap - (lowest - top)).max(0.0);
        let within = (2.0 * spare * self.radius / level.steep).sqrt() + 1e-9;
        within.min(self.radius)
    }

    /// First column of a row of squares, of which the first one begins at `corner`, and the one after the
    /// last one that may lie below the wheel and within `beside` (m) of its middle plane's line.
    pub fn columns(&self, corner: Point2<f64>, beside: f64) -> (f64, f64) {
        let Some(level) = &self.level else { return (0.0, f64::INFINITY) };
        let (start, side) = (corner - self.center.xy(), 2.0 * self.half_side);
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for (way, reach) in [(&level.along, level.reach), (&level.aside, beside)] {
            if way.x.abs() > 1e-9 {
                // Where the middle of the row, and what it is wide, comes within reach.
                let middle = -way.y * (start.y + self.half_side) / way.x - start.x;
                let reach = (reach + self.half_side * way.y.abs()) / way.x.abs();
                (from, to) = (from.max(middle - reach), to.min(middle + reach));
            }
        }
        ((from / side - 1e-6).floor(), (to / side + 1e-6).floor() + 1.0)
    }

    /// A gap that is no larger than any over the square from `corner` on, with these heights at its
    /// corners; infinite beside the wheel.
    ///
    /// Over each triangle of the ground the gap to a plane is least at a corner, and the wheel lies above
    /// the plane that touches it there.
    pub fn over_square(&self, corner: Point2<f64>, heights: [f64; 4]) -> f64 {
        let Some(level) = &self.level else { return self.lowest - super::highest_of(&heights) };
        let (start, side) = (corner - self.center.xy(), 2.0 * self.half_side);
        let middle = start + Vector2::repeat(self.half_side);
        let (aside, along) = (level.aside.dot(&middle), level.along.dot(&middle));
        if along.abs() - self.half_diagonal > level.reach
            || aside.abs() - self.half_diagonal > self.radius
        {
            return f64::INFINITY;
        }
        self.plane(level, aside).above(&start, side, heights)
    }

    /// As [`over_square`](Self::over_square), by the plane that touches the wheel above `touch`: about a
    /// place where the ground is nearest, this one is as close as can be.
    pub fn over_square_from(
        &self,
        touch: Point2<f64>,
        corner: Point2<f64>,
        heights: [f64; 4],
    ) -> f64 {
        let Some(level) = &self.level else { return f64::NEG_INFINITY };
        let aside = level.aside.dot(&(touch - self.center.xy()));
        let start = corner - self.center.xy();
        self.plane(level, aside).above(&start, 2.0 * self.half_side, heights)
    }

    /// The part of an edge of the grid that may lie below the wheel; none if none does.
    pub fn over_edge<'u>(
        &'u self,
        level: &'u Level,
        a: Point2<f64>,
        b: Point2<f64>,
    ) -> Option<Line<'u>> {
        let (from, way) = (a - self.center.xy(), b - a);
        let (mut t0, mut t1) = (0.0_f64, 1.0_f64);
        for (direction, reach) in [(&level.along, level.reach), (&level.aside, self.radius)] {
            let (start, rate) = (direction.dot(&from), direction.dot(&way));
            if rate.abs() > 1e-12 {
                let ends = [(-reach - start) / rate, (reach - start) / rate];
                (t0, t1) = (t0.max(ends[0].min(ends[1])), t1.min(ends[0].max(ends[1])));
            } else if start.abs() > reach {
                return None;
            }
        }
        (t0 <= t1).then_some(Line { under: self, level, from, way, ends: [t0, t1] })
    }

    /// The plane that touches the wheel's round as far aside: the wheel lies above it.
    fn plane(&self, level: &Level, aside: f64) -> Tangent {
        let sine = (aside / self.radius).clamp(-0.9, 0.9);
        let cosine = (1.0 - sine * sine).sqrt();
        let steep = 1.0 / (cosine * level.up.z);
        let slope = (level.aside * sine - level.up.xy() * cosine) * steep;
        Tangent { slope, height: self.center.z - self.radius * steep }
    }
}

/// A part of an edge of the grid: from the wheel's center to its start, and on, by a share of its way.
pub(crate) struct Line<'u> {
    under: &'u Underside,
    level: &'u Level,
    from: Vector2<f64>,
    way: Vector2<f64>,
    pub ends: [f64; 2],
}

impl Line<'_> {
    /// A gap that is no larger than any over ground that begins at `z` and rises by `rise` (m): by
    /// the plane that touches the wheel above the share `t`.
    pub fn bound(&self, t: f64, z: f64, rise: f64) -> f64 {
        let aside = self.level.aside.dot(&(self.from + self.way * t));
        let plane = self.under.plane(self.level, aside);
        let gap = |t: f64| plane.at(&(self.from + self.way * t)) - (z + rise * t);
        gap(self.ends[0]).min(gap(self.ends[1]))
    }

    /// The share at which the wheel's round is nearest to ground that rises by `rise` (m).
    pub fn nearest(&self, rise: f64) -> f64 {
        let (level, under) = (self.level, self.under);
        let (start, rate) = (level.aside.dot(&self.from), level.aside.dot(&self.way));
        let tangent = rise * level.up.z + level.up.xy().dot(&self.way);
        // Where the round is as steep as the ground; along the axle it is steep nowhere.
        let aside = under.radius * tangent * rate.signum() / tangent.hypot(rate);
        let t = (aside - start) / rate;
        if t.is_nan() { self.ends[0] } else { t.clamp(self.ends[0], self.ends[1]) }
    }
}

/// A plane by its height below the wheel's center and its slope.
struct Tangent {
    slope: Vector2<f64>,
    height: f64,
}

impl Tangent {
    fn at(&self, from_center: &Vector2<f64>) -> f64 {
        self.height + self.slope.dot(from_center)
    }

    /// Its least height above the corners of a square that begins at `start`.
    fn above(&self, start: &Vector2<f64>, side: f64, [z00, z10, z01, z11]: [f64; 4]) -> f64 {
        let at = self.at(start);
        let (x, y) = (self.slope.x * side, self.slope.y * side);
        (at - z00).min(at + x - z10).min(at + y - z01).min(at + x + y - z11)
    }
}
