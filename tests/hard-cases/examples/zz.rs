//! scratch
use hex_mesh::*; use pd_solver::*; use nalgebra::*;
fn main(){
 let mesh=HexMesh::solid_box([12,8,8],0.25,Quadrature::Eight).unwrap();
 let mut s=Solver::new(&mesh,&[EffectSpec::Elasticity{stiffness:1.0},EffectSpec::Floating{}]).unwrap();
 let mut p=s.rest_parameters(); p.actuation.fill([0.2, 0.1, 0.0, -0.1, -0.2, 0.1]);
        let turn = Rotation3::new(Vector3::new(0.4, -1.1, 0.3));
 let far:Vec<_>=mesh.nodes().iter().map(|x| turn*x+Vector3::new(3.0,-2.0,7.0)).collect();
 for st in [None,Some(&far[..])] { for m in [Method::Multigrid,Method::Newton]{ for lim in [1,2,3,4,5,6,8,10,20,50,200] { 
  let o=SolveOptions{max_iterations:lim,..SolveOptions::new(Stop::Accuracy(1e-9)).with_method(m)};
  let sol=s.solve(&p,st,&o).unwrap();
  println!("{m:?} {lim} {:?} E {:.10e} g {:.2e} it {} fell {} est {:?} {:?} neg {:?}",sol.status,sol.stats.energy,sol.stats.gradient_norm,sol.stats.iterations,sol.stats.fell_back,sol.stats.estimated_error,sol.stats.estimate,sol.stats.negative_curvature);
 }}}
}
