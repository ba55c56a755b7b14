//! Zero-length springs from points of the body to targets.

use super::build::finite;
use super::{CoarseView, Effect, FormVisitor};
use crate::constant::ConstantMatrix;
use crate::error::SolverError;
use crate::parameters::Parameters;
use crate::spec::SpringPoints;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// Energy `sum_p k_p / 2 |x_p - target_p|^2` with `x_p = sum_c w_pc u_c` over the corners of the element that holds the point.
pub(crate) struct Springs {
    springs: Vec<Spring>,
    targets: Vec<Vector3<f64>>,
    /// This effect's first entry in [`Parameters::spring_targets`].
    first: usize,
}

struct Spring {
    nodes: Vec<u32>,
    weights: Vec<f64>,
    stiffness: f64,
}

impl Spring {
    fn point(&self, u: &[Vector3<f64>]) -> Vector3<f64> {
        let corners = self.nodes.iter().zip(&self.weights);
        corners.map(|(&n, w)| u[n as usize] * *w).sum()
    }

    fn scatter(&self, force: &Vector3<f64>, out: &mut NodalVector) {
        for (&n, w) in self.nodes.iter().zip(&self.weights) {
            out[n as usize] += force * *w;
        }
    }
}

impl Springs {
    pub(crate) fn new(
        mesh: &HexMesh,
        points: &SpringPoints,
        stiffness: f64,
        first: usize,
        index: usize,
    ) -> Result<Self, SolverError> {
        let springs = match points {
            SpringPoints::Nodes(set) => at_nodes(&set.resolve(mesh, index)?, stiffness),
            SpringPoints::Embedded { points, factors } => {
                embedded(mesh, points, factors, stiffness, index)?
            }
        };
        let targets = springs.iter().map(|s| s.point(mesh.nodes())).collect();
        Ok(Self {
            springs,
            targets,
            first,
        })
    }

    /// Springs of equal stiffness from linear forms over nodes; `rest` holds the positions of all nodes.
    pub(crate) fn from_forms(
        forms: Vec<(Vec<u32>, Vec<f64>)>,
        stiffness: f64,
        first: usize,
        rest: &[Vector3<f64>],
    ) -> Self {
        let spring = |(nodes, weights)| Spring {
            nodes,
            weights,
            stiffness,
        };
        let springs: Vec<Spring> = forms.into_iter().map(spring).collect();
        Self {
            targets: springs.iter().map(|s| s.point(rest)).collect(),
            springs,
            first,
        }
    }

    /// Where the points are at rest: targets for which the springs pull nowhere.
    pub(crate) fn rest_targets(&self) -> &[Vector3<f64>] {
        &self.targets
    }

    /// Nodes that a spring holds with a weight other than zero.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = u32> + '_ {
        let corners = self
            .springs
            .iter()
            .flat_map(|s| s.nodes.iter().zip(&s.weights));
        corners.filter(|(_, w)| **w != 0.0).map(|(&n, _)| n)
    }
}

fn at_nodes(nodes: &[u32], stiffness: f64) -> Vec<Spring> {
    let spring = |&node: &u32| Spring {
        nodes: vec![node],
        weights: vec![1.0],
        stiffness,
    };
    nodes.iter().map(spring).collect()
}

fn embedded(
    mesh: &HexMesh,
    points: &[hex_mesh::EmbeddedPoint],
    factors: &[f64],
    stiffness: f64,
    index: usize,
) -> Result<Vec<Spring>, SolverError> {
    if factors.len() != points.len() {
        return Err(SolverError::WrongLength {
            what: "factors",
            found: factors.len(),
            expected: points.len(),
        });
    }
    let count = mesh.elements().len();
    let spring = |(point, &factor): (&hex_mesh::EmbeddedPoint, &f64)| {
        finite(index, "factors", factor)?;
        if factor < 0.0 {
            return Err(SolverError::BadValue {
                index,
                field: "factors",
                value: factor,
                expected: "zero or more",
            });
        }
        let found = point.element as usize;
        let corners = mesh.elements().get(found).ok_or(SolverError::OutOfRange {
            index,
            what: "element",
            found,
            count,
        })?;
        Ok(Spring {
            nodes: corners.to_vec(),
            weights: point.weights.to_vec(),
            stiffness: stiffness * factor,
        })
    };
    points.iter().zip(factors).map(spring).collect()
}

impl Effect for Springs {
    fn add_constant(&self, matrix: &mut ConstantMatrix) {
        for s in &self.springs {
            matrix.add_outer(&s.nodes, &s.weights, s.stiffness);
        }
    }

    fn set_parameters(&mut self, parameters: &Parameters) {
        let range = self.first..self.first + self.springs.len();
        self.targets
            .copy_from_slice(&parameters.spring_targets[range]);
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let mut energy = 0.0;
        for (s, target) in self.springs.iter().zip(&self.targets) {
            let stretch = s.point(u) - target;
            energy += 0.5 * s.stiffness * stretch.norm_squared();
            s.scatter(&(stretch * s.stiffness), gradient);
        }
        energy
    }

    fn linearise(&mut self, _u: &[Vector3<f64>]) {}

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        for s in &self.springs {
            s.scatter(&(s.point(x) * s.stiffness), out);
        }
    }

    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters) {
        for (i, s) in self.springs.iter().enumerate() {
            out.spring_targets[self.first + i] += s.point(z) * s.stiffness;
        }
    }

    fn coarsen(&self, view: &CoarseView) -> Option<Box<dyn Effect>> {
        let springs = self.springs.iter().map(|s| {
            let (nodes, weights) = view.transfer.restrict_form(&s.nodes, &s.weights);
            Spring {
                nodes,
                weights,
                stiffness: s.stiffness,
            }
        });
        Some(Box::new(Self {
            springs: springs.collect(),
            targets: self.targets.clone(),
            first: self.first,
        }))
    }

    fn for_each_form(&self, f: FormVisitor) {
        for s in &self.springs {
            f(&s.nodes, &s.weights, s.stiffness);
        }
    }

    fn largest_diagonal(&self) -> f64 {
        self.springs.iter().map(|s| s.stiffness).fold(0.0, f64::max)
    }

    fn bytes(&self) -> usize {
        let one = |s: &Spring| {
            size_of_val(s) + size_of_val(s.nodes.as_slice()) + size_of_val(s.weights.as_slice())
        };
        self.springs.iter().map(one).sum::<usize>() + size_of_val(self.targets.as_slice())
    }
}
