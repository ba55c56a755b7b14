//! Bodies to try, and what is done with them.

use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, EmbeddedSurface, Method, NodeSet, Parameters, Solver};

/// All methods, each by itself.
pub const METHODS: [Method; 5] = [
    Method::LocalGlobal,
    Method::Anderson,
    Method::Lbfgs,
    Method::Multigrid,
    Method::Newton,
];

/// Name of a method as a user writes it.
pub fn name(method: Method) -> &'static str {
    match method {
        Method::Automatic => "automatic",
        Method::LocalGlobal => "local-global",
        Method::Anderson => "anderson",
        Method::Lbfgs => "lbfgs",
        Method::Multigrid => "multigrid",
        Method::Newton => "newton",
    }
}

/// A body with its solver.
pub struct Body {
    pub mesh: HexMesh,
    pub solver: Solver,
    /// The largest stiffness in it: what roundoff of a gradient goes by.
    pub stiffest: f64,
}

/// The elasticity that every body has.
pub fn elasticity() -> EffectSpec {
    EffectSpec::Elasticity { stiffness: 1.0 }
}

/// Nodes held where they are at rest.
pub fn held(nodes: Vec<u32>) -> EffectSpec {
    EffectSpec::Prescribed {
        nodes: NodeSet::Indices(nodes),
    }
}

impl Body {
    /// A body under its effects.
    ///
    /// # Panics
    /// When the case itself is wrong.
    pub fn new(mesh: HexMesh, effects: &[EffectSpec]) -> Self {
        let solver = Solver::new(&mesh, effects).expect("a valid case");
        Self {
            mesh,
            solver,
            stiffest: 1.0,
        }
    }

    /// A body under its effects, some of which act on its boundary.
    ///
    /// # Panics
    /// When the case itself is wrong.
    pub fn on_boundary(mesh: HexMesh, effects: &[EffectSpec]) -> Self {
        let surface = EmbeddedSurface::boundary(&mesh);
        let solver = Solver::on_surface(&mesh, &surface, effects).expect("a valid case");
        Self {
            mesh,
            solver,
            stiffest: 1.0,
        }
    }

    /// A solid box of cubes, its face at x = 0 held.
    pub fn bar(cells: [usize; 3], size: f64) -> Self {
        let mesh = HexMesh::solid_box(cells, size, Quadrature::Eight).expect("a valid box");
        Self::held_at_wall(mesh)
    }

    /// A mesh of which all nodes at x = 0 are held.
    pub fn held_at_wall(mesh: HexMesh) -> Self {
        let wall = nodes_where(&mesh, |x| x.x == 0.0);
        Self::new(mesh, &[elasticity(), held(wall)])
    }

    /// Lowest and highest corner of the bounding box at rest.
    pub fn bounds(&self) -> [Vector3<f64>; 2] {
        let nodes = self.mesh.nodes();
        let fold = |f: fn(f64, f64) -> f64| {
            let first = nodes[0];
            nodes.iter().fold(first, |a, b| a.zip_map(b, f))
        };
        [fold(f64::min), fold(f64::max)]
    }

    /// Rest parameters with an actuation per sample, given by element and sample.
    pub fn actuated(&self, mut b: impl FnMut(usize, usize) -> [f64; 6]) -> Parameters {
        let mut parameters = self.solver.rest_parameters();
        let samples = parameters.actuation.len() / self.mesh.elements().len();
        for (i, own) in parameters.actuation.iter_mut().enumerate() {
            *own = b(i / samples, i % samples);
        }
        parameters
    }
}

/// Nodes whose rest position satisfies a condition.
pub fn nodes_where(mesh: &HexMesh, keep: impl Fn(&Vector3<f64>) -> bool) -> Vec<u32> {
    let nodes = mesh.nodes().iter().enumerate();
    let kept = nodes.filter(|(_, x)| keep(x));
    kept.map(|(i, _)| i as u32).collect()
}

/// The longest distance between two shapes of one body.
pub fn max_distance(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let pairs = a.iter().zip(b);
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}
