//! probe
use pd_solver::deformation_gradients;
use std::path::Path;
use trainer::{body::Body, evaluate::Evaluator, run::Run, trained::Trained};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let run = Run::open(Path::new(&args[1])).unwrap();
    let Trained {
        scene,
        body,
        shapes,
        net,
        ..
    } = Trained::load(&run, None).unwrap();
    let _: &Body = &body;
    let mut ev = Evaluator::new(&body, &scene).unwrap();
    let mut kind = vec![0u8; body.mesh.nodes().len()];
    for &n in &body.fixed_nodes {
        kind[n as usize] = 1;
    }
    for &n in &body.moved_nodes {
        kind[n as usize] = 2;
    }
    let both = body
        .mesh
        .elements()
        .iter()
        .filter(|e| {
            e.iter().any(|&n| kind[n as usize] == 1) && e.iter().any(|&n| kind[n as usize] == 2)
        })
        .count();
    println!(
        "{} elements, {both} with nodes of both bones",
        body.mesh.elements().len()
    );
    for name in &args[2..] {
        let shape = shapes.all.iter().find(|s| &s.name == name).unwrap();
        let d = shapes.descriptor(&shape.positions).unwrap();
        let r = ev.shape(&net, shape, d, None).unwrap();
        let g = deformation_gradients(&body.mesh, &r.nodes);
        let s = body.mesh.quadrature().len();
        println!("{name}: inverted {}", r.inverted_elements);
        for (e, f) in g.chunks(s).enumerate() {
            let bad = f.iter().filter(|f| f.determinant() <= 0.0).count();
            if bad > 0 {
                let c = body.mesh.element_corner(e);
                let k: Vec<u8> = body.mesh.elements()[e]
                    .iter()
                    .map(|&n| kind[n as usize])
                    .collect();
                println!(
                    "  {e} at {:.2} {:.2} {:.2} bad samples {bad} kinds {k:?} min det {:.2}",
                    c.x,
                    c.y,
                    c.z,
                    f.iter().map(|f| f.determinant()).fold(9.0, f64::min)
                );
            }
        }
    }
}
