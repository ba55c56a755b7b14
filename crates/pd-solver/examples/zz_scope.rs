//! scratch
use hex_mesh::*; use pd_solver::*;
use nalgebra::Vector3;
fn main() {
    let cells=[32usize,16,16];
    let mesh = HexMesh::solid_box(cells, 0.01, Quadrature::Eight).unwrap();
    let eff=[EffectSpec::Elasticity{stiffness:1.0},EffectSpec::Prescribed{nodes:NodeSet::Region(NodeRegion::Plane{axis:Axis::X,value:0.0})}];
    let mut s=Solver::new(&mesh,&eff).unwrap();
    let mut p=s.rest_parameters();
    for (cell,b) in mesh.cells().iter().zip(p.actuation.chunks_mut(8)) {
        let c:[f64;3]=std::array::from_fn(|a|(cell[a] as f64+0.5)/cells[a] as f64);
        let q=0.3*(2.0*c[2]-1.0);
        b.fill([q,0.05*(std::f64::consts::TAU*c[0]).sin(),0.0,-0.15*q,0.05*(std::f64::consts::TAU*c[1]).cos(),-0.5*q]);
    }
    let o=SolveOptions::new(Stop::RelativeGradient(1e-4));
    let cot: Vec<_>=(0..mesh.nodes().len()).map(|i|Vector3::new(1.0,(i as f64*0.7).sin(),(i as f64*1.3).cos())).collect();
    let at=s.solve(&p,None,&o).unwrap();
    for round in 0..2 { for inside in [false,true] {
        let mut run = || { let mut best=(f64::MAX,f64::MAX,f64::MAX); for _ in 0..8 {
            best.0=s.solve(&p,None,&o).unwrap().stats.seconds.min(best.0);
            best.1=s.adjoint(&p,&at,&cot,&AdjointOptions{tolerance:1e-6,..Default::default()}).unwrap().stats.seconds.min(best.1);
            let l=SolveOptions{max_iterations:40,..SolveOptions::new(Stop::RelativeGradient(1e-12)).with_method(Method::LocalGlobal)};
            best.2=(s.solve(&p,None,&l).unwrap().stats.seconds/40.0).min(best.2);
        } best };
        let b = if inside { rayon::scope(|_| run()) } else { run() };
        println!("round {round} inside {inside}: forward {:.0} ms, adjoint {:.0} ms, local/global step {:.1} ms", b.0*1e3,b.1*1e3,b.2*1e3);
    }}
    let t=std::time::Instant::now(); for _ in 0..50 { s.energy_gradient(&p,&at.positions).unwrap(); } println!("evaluation {:.2} ms", t.elapsed().as_secs_f64()*20.0);
}
