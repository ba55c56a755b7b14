//! Gauss-Legendre quadrature on the unit cube, and the gradients of the shape functions at its points.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::{HexMeshError, trilinear_gradients};

/// How many sample points each element has: the tensor product of 1, 2 or 3 Gauss-Legendre points.
///
/// `n` points per axis integrate polynomials of degree `2 n - 1` in each coordinate exactly. In a scene file it is the number 1, 8
/// or 27.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(try_from = "usize", into = "usize")]
pub enum Quadrature {
    /// One point at the centre. Blind to the twelve hourglass modes of the cube.
    One,
    /// 2 x 2 x 2 points: the usual choice for trilinear elements.
    #[default]
    Eight,
    /// 3 x 3 x 3 points.
    TwentySeven,
}

impl Quadrature {
    /// The rule with `count` points per element.
    ///
    /// # Errors
    /// [`HexMeshError::QuadratureCount`] unless `count` is 1, 8 or 27.
    pub fn from_count(count: usize) -> Result<Self, HexMeshError> {
        match count {
            1 => Ok(Self::One),
            8 => Ok(Self::Eight),
            27 => Ok(Self::TwentySeven),
            _ => Err(HexMeshError::QuadratureCount { count }),
        }
    }

    /// Number of points per element: 1, 8 or 27.
    #[must_use]
    pub const fn count(self) -> usize {
        match self {
            Self::One => 1,
            Self::Eight => 8,
            Self::TwentySeven => 27,
        }
    }

    /// Points in `[0, 1]` and weights summing to 1 along one axis.
    fn axis_rule(self) -> Vec<(f64, f64)> {
        let on_unit = |x: f64| 0.5 * (1.0 + x);
        match self {
            Self::One => vec![(0.5, 1.0)],
            Self::Eight => {
                let x = 1.0 / 3.0_f64.sqrt();
                vec![(on_unit(-x), 0.5), (on_unit(x), 0.5)]
            }
            Self::TwentySeven => {
                let x = 0.6_f64.sqrt();
                let (outer, middle) = (5.0 / 18.0, 4.0 / 9.0);
                vec![(on_unit(-x), outer), (0.5, middle), (on_unit(x), outer)]
            }
        }
    }
}

impl TryFrom<usize> for Quadrature {
    type Error = HexMeshError;

    fn try_from(count: usize) -> Result<Self, HexMeshError> {
        Self::from_count(count)
    }
}

impl From<Quadrature> for usize {
    fn from(quadrature: Quadrature) -> Self {
        quadrature.count()
    }
}

/// Points and weights on the unit cube, x slowest and z fastest, like the corners.
#[derive(Debug, Clone, PartialEq)]
pub struct QuadratureRule {
    /// Sample points in cube coordinates, each in `[0, 1]^3`.
    pub points: Vec<Vector3<f64>>,
    /// Weight of each point; they sum to 1. The weight in space is this times the element's volume.
    pub weights: Vec<f64>,
}

impl QuadratureRule {
    /// The Gauss-Legendre tensor rule.
    #[must_use]
    pub fn new(quadrature: Quadrature) -> Self {
        let axis = quadrature.axis_rule();
        let mut rule = Self {
            points: Vec::with_capacity(quadrature.count()),
            weights: Vec::with_capacity(quadrature.count()),
        };
        for &(x, wx) in &axis {
            for &(y, wy) in &axis {
                for &(z, wz) in &axis {
                    rule.points.push(Vector3::new(x, y, z));
                    rule.weights.push(wx * wy * wz);
                }
            }
        }
        rule
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point (never, for a rule made by [`QuadratureRule::new`]).
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Gradients `dN_n / dx` of the eight corner weights at each point, for cubes of edge length `size`, in 1 / length.
    ///
    /// The deformation gradient at a sample is `F = sum_n u_n (dN_n / dx)^T` over the corner positions `u_n`.
    #[must_use]
    pub fn gradients(&self, size: f64) -> Vec<[Vector3<f64>; 8]> {
        let in_space = |point| trilinear_gradients(point).map(|gradient| gradient / size);
        self.points.iter().map(in_space).collect()
    }
}
