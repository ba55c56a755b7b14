//! The classes of samples that are drawn.

use super::draws::{
    Draw, Planted, between, decades, ordinary_actuation, ordinary_deformation, scaled,
};
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use polar_grad::testing::Random;

/// A class of samples.
#[derive(Clone, Copy)]
pub struct Class {
    /// Its name after `sample`.
    pub name: &'static str,
    /// What is hard about it.
    pub story: &'static str,
    make: fn(&mut Random) -> Draw,
}

impl Class {
    /// The draw of this number: it depends on nothing else, so that one that fails can be drawn again.
    pub fn draw(&self, number: u64) -> Draw {
        // Neighbouring seeds give shifted sequences; their hashes do not.
        (self.make)(&mut Random::new(Random::new(number).bits()))
    }
}

/// Singular values of an ordinary deformation, upright or inverted.
fn ordinary(r: &mut Random) -> [f64; 3] {
    let inverted = r.bits().is_multiple_of(2);
    let z = between(r, 0.2, 0.5);
    [
        between(r, 0.5, 2.0),
        between(r, 0.55, 1.5),
        if inverted { -z } else { z },
    ]
}

/// A symmetric matrix with these eigenvalues between random axes.
fn symmetric(r: &mut Random, values: [f64; 3]) -> Matrix3<f64> {
    let q = r.rotation();
    let a = q * Matrix3::from_diagonal(&Vector3::from(values)) * q.transpose();
    (a + a.transpose()) * 0.5
}

/// A sample of an actuation with these eigenvalues.
fn actuated(r: &mut Random, values: [f64; 3]) -> Draw {
    let f = ordinary_deformation(r);
    let a = symmetric(r, values);
    Draw::of_actuation(r, f, a)
}

/// A sample of entries of about this size, exactly a power of two times an ordinary one.
fn of_size(r: &mut Random, exponents: [i32; 2]) -> Draw {
    let e = between(r, f64::from(exponents[0]), f64::from(exponents[1])) as i32;
    let values = ordinary(r);
    let (u, v) = (r.rotation(), r.rotation());
    let planted = Planted::new(u, Vector3::from(values), v);
    // Denormal entries round, and then the planted values are no more the matrix's.
    let known = (e > -1000).then(|| Planted {
        sigma: planted.sigma * 2.0_f64.powi(e),
        ..planted
    });
    let m = scaled(&planted.matrix(), e);
    Draw::of_product(r, m, known)
}

/// A half turn about a random axis, or one of the three axes.
fn half_turn(r: &mut Random) -> Matrix3<f64> {
    let mut axis: Vector3<f64> = r.rotation().column(0).into();
    let choice = (r.bits() % 8) as usize;
    if choice < 3 {
        axis = Vector3::ith(choice, 1.0);
    }
    let half = Rotation3::from_axis_angle(&Unit::new_normalize(axis), std::f64::consts::PI);
    half.into_inner()
}

/// All classes, in the order of the catalogue.
pub const CLASSES: &[Class] = &[
    Class {
        name: "ordinary",
        story: "upright or inverted, nothing equal and nothing small: what all others are held against",
        make: |r| {
            let values = ordinary(r);
            Draw::of_values(r, values)
        },
    },
    Class {
        name: "at rest",
        story: "a rotation: all singular values are one, and their vectors arbitrary",
        make: |r| {
            let m = r.rotation();
            let planted = Planted {
                u: m,
                sigma: Vector3::repeat(1.0),
                v: Matrix3::identity(),
            };
            Draw::of_product(r, m, Some(planted))
        },
    },
    Class {
        name: "at the target",
        story: "F = R A: the energy is zero, and so are three eigenvalues of the core",
        make: |r| {
            let (q, a) = (r.rotation(), ordinary_actuation(r));
            Draw::of_actuation(r, q * a, a)
        },
    },
    Class {
        name: "three equal",
        story: "a multiple of a rotation, from a thousandth to a thousand",
        make: |r| {
            let s = decades(r, -3.0, 3.0);
            Draw::of_values(r, [s; 3])
        },
    },
    Class {
        name: "two equal",
        story: "the two larger, the two smaller, or the outer ones by size",
        make: |r| {
            let (s, t) = (between(r, 0.3, 2.0), between(r, -1.0, 1.0));
            Draw::of_values(r, [s, s, s * t])
        },
    },
    Class {
        name: "nearly equal",
        story: "singular values that differ by 1e-1 to 1e-16",
        make: |r| {
            let split = decades(r, -16.0, -1.0);
            let z = if r.bits().is_multiple_of(2) { 1.0 } else { 0.4 };
            let values = [1.0, z, z].map(|s| s + split * r.signed());
            Draw::of_values(r, values)
        },
    },
    Class {
        name: "reflected from above",
        story: "s_y + s_z from 1e-2 to 1e-16: the rotation is about to jump",
        make: |r| {
            let (x, y, gap) = (
                between(r, 1.0, 1.5),
                between(r, 0.1, 1.0),
                decades(r, -16.0, -2.0),
            );
            Draw::of_values(r, [x, y, -y + gap])
        },
    },
    Class {
        name: "reflected from below",
        story: "the same beyond the jump: another pair of vectors has become the last",
        make: |r| {
            let (x, y, gap) = (
                between(r, 1.0, 1.5),
                between(r, 0.1, 0.9),
                decades(r, -16.0, -2.0),
            );
            Draw::of_values(r, [x, y, -y - gap])
        },
    },
    Class {
        name: "at the jump",
        story: "s_y = -s_z up to rounding: a circle of rotations is equally near",
        make: |r| {
            let (x, y) = (between(r, 1.0, 1.5), between(r, 0.1, 1.0));
            Draw::of_values(r, [x, y, -y])
        },
    },
    Class {
        name: "reflection",
        story: "an improper orthogonal matrix: a sphere of rotations is equally near",
        make: |r| {
            let s = if r.bits().is_multiple_of(2) {
                1.0
            } else {
                -1.0
            };
            Draw::of_values(r, [s, s, -1.0])
        },
    },
    Class {
        name: "rank two",
        story: "the last singular value is zero, or from 1e-4 down to the smallest numbers, of either sign",
        make: |r| {
            let z = match r.bits() % 3 {
                0 => 0.0,
                1 => decades(r, -300.0, -4.0),
                _ => -decades(r, -300.0, -4.0),
            };
            let values = [between(r, 0.9, 2.0), between(r, 0.1, 0.9), z];
            Draw::of_values(r, values)
        },
    },
    Class {
        name: "rank one",
        story: "an outer product: the rotation about its direction is free",
        make: |r| {
            let (x, small) = (between(r, 0.3, 2.0), decades(r, -300.0, -10.0));
            let values = match r.bits() % 3 {
                0 => [x, 0.0, 0.0],
                1 => [x, small, small * r.signed()],
                _ => [x, small, -small],
            };
            Draw::of_values(r, values)
        },
    },
    Class {
        name: "rank one, exact",
        story: "an outer product of whole numbers, which no rounding makes regular",
        make: |r| {
            let mut whole = || Vector3::from_fn(|_, _| (r.bits() % 7) as f64 - 3.0);
            let m = whole() * whole().transpose();
            Draw::of_product(r, m, None)
        },
    },
    Class {
        name: "rank zero",
        story: "a point: zeros of either sign",
        make: |r| {
            let m = Matrix3::from_fn(|_, _| 0.0_f64.copysign(r.signed()));
            Draw::of_product(r, m, None)
        },
    },
    Class {
        name: "graded",
        story: "singular values decades apart, upright or inverted",
        make: |r| {
            let y = decades(r, -12.0, 0.0);
            let z = y * decades(r, -12.0, 0.0);
            let sign = if r.bits().is_multiple_of(2) {
                1.0
            } else {
                -1.0
            };
            Draw::of_values(r, [1.0, y, z * sign])
        },
    },
    Class {
        name: "whole numbers",
        story: "entries from -2 to 2: ties and singular matrices, exactly",
        make: |r| {
            let m = Matrix3::from_fn(|_, _| (r.bits() % 5) as f64 - 2.0);
            Draw::of_product(r, m, None)
        },
    },
    Class {
        name: "half turn",
        story: "turned by 180 degrees about any axis, where quaternions and axis-angles change sign",
        make: |r| {
            let values = [between(r, 1.0, 1.5), 1.0, between(r, 0.5, 1.0)];
            let m = half_turn(r) * symmetric(r, values);
            let plain = r.bits().is_multiple_of(2);
            let m = if plain { half_turn(r) } else { m };
            Draw::of_product(r, m, None)
        },
    },
    Class {
        name: "squeezed",
        story: "F = c R A with c from 1e-3 to 1: indefinite however small the squeeze",
        make: |r| {
            let (q, a, c) = (r.rotation(), ordinary_actuation(r), decades(r, -3.0, 0.0));
            Draw::of_actuation(r, q * a * c, a)
        },
    },
    Class {
        name: "A indefinite",
        story: "one or two eigenvalues of the actuation are negative: the target is inside out",
        make: |r| {
            let values = [
                between(r, 0.5, 1.5),
                between(r, -1.5, 1.5),
                -between(r, 0.1, 1.5),
            ];
            actuated(r, values)
        },
    },
    Class {
        name: "A singular",
        story: "the actuation flattens to a plane, exactly or nearly",
        make: |r| {
            let z = if r.bits().is_multiple_of(2) {
                0.0
            } else {
                decades(r, -16.0, -4.0)
            };
            let values = [between(r, 0.5, 1.5), between(r, 0.5, 1.5), z];
            actuated(r, values)
        },
    },
    Class {
        name: "A of rank one",
        story: "the actuation flattens to a line: the core meets a derivative without bound",
        make: |r| {
            let values = [between(r, 0.5, 1.5), 0.0, 0.0];
            actuated(r, values)
        },
    },
    Class {
        name: "A zero",
        story: "the material wants to be a point",
        make: |r| {
            let f = ordinary_deformation(r);
            Draw::of_actuation(r, f, Matrix3::zeros())
        },
    },
    Class {
        name: "A a reflection",
        story: "the actuation is minus one, or a mirror",
        make: |r| {
            let values = if r.bits().is_multiple_of(2) {
                [-1.0; 3]
            } else {
                [1.0, 1.0, -1.0]
            };
            actuated(r, values)
        },
    },
    Class {
        name: "A huge",
        story: "the material wants to be up to 1e8 times as large",
        make: |r| {
            let (f, a) = (ordinary_deformation(r), ordinary_actuation(r));
            let size = decades(r, 0.0, 8.0);
            Draw::of_actuation(r, f, a * size)
        },
    },
    Class {
        name: "A tiny",
        story: "the material wants to be down to 1e-8 times as large",
        make: |r| {
            let (f, a) = (ordinary_deformation(r), ordinary_actuation(r));
            let size = decades(r, -8.0, 0.0);
            Draw::of_actuation(r, f, a * size)
        },
    },
    Class {
        name: "A of mixed sizes",
        story: "eigenvalues of the actuation from 1e-8 to 1e8 in one matrix, of either sign",
        make: |r| {
            let values = [(); 3].map(|()| decades(r, -8.0, 8.0).copysign(r.signed()));
            actuated(r, values)
        },
    },
    Class {
        name: "F huge or tiny",
        story: "blown up or shrunk by up to 1e100 before an ordinary actuation",
        make: |r| {
            let (f, a) = (ordinary_deformation(r), ordinary_actuation(r));
            let size = decades(r, -100.0, 100.0);
            Draw::of_actuation(r, f * size, a)
        },
    },
    Class {
        name: "F and A huge or tiny",
        story: "both from 1e-70 to 1e70: the unit of length is badly chosen",
        make: |r| {
            let (f, a) = (ordinary_deformation(r), ordinary_actuation(r));
            let size = decades(r, -70.0, 70.0);
            Draw::of_actuation(r, f * size, a * size)
        },
    },
    Class {
        name: "near overflow",
        story: "entries from 1e150 to 1e307: squares, cubes and determinants overflow",
        make: |r| of_size(r, [498, 1020]),
    },
    Class {
        name: "at overflow",
        story: "entries up to the largest number: even the sum of two overflows",
        make: |r| {
            let m = r.matrix();
            let m = m / m.amax();
            let m = m * f64::MAX;
            // Only the identity leaves such a product finite.
            Draw::of_actuation(r, m, Matrix3::identity())
        },
    },
    Class {
        name: "near underflow",
        story: "entries from 1e-150 to 1e-307: squares, cubes and determinants underflow",
        make: |r| of_size(r, [-1020, -498]),
    },
    Class {
        name: "denormal",
        story: "entries from 1e-307 to the smallest number: digits are missing",
        make: |r| of_size(r, [-1074, -1020]),
    },
    Class {
        name: "any bits",
        story: "entries of any size at all in one matrix",
        make: |r| {
            let m = Matrix3::from_fn(|_, _| {
                loop {
                    let x = f64::from_bits(r.bits());
                    if x.is_finite() {
                        break x;
                    }
                }
            });
            Draw::of_actuation(r, m, Matrix3::identity())
        },
    },
];
