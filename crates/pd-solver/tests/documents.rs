//! What `docs/effects.md` shows of TOML is read as it stands there.

use pd_solver::EffectSpec;
use std::collections::BTreeSet;

const PAGE: &str = include_str!("../../../docs/effects.md");

#[derive(serde::Deserialize)]
struct Scene {
    effects: Vec<EffectSpec>,
}

#[test]
fn effects_are_written_as_the_page_says() {
    let mut kinds = BTreeSet::new();
    for block in PAGE.split("```toml\n").skip(1) {
        let text = block.split("```").next().expect("a block ends");
        let scene: Scene = toml::from_str(text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        kinds.extend(scene.effects.iter().map(EffectSpec::kind));
    }
    let rows = PAGE.lines().filter_map(|line| line.strip_prefix("| `"));
    let named = rows.filter_map(|row| row.split('`').next());
    let named: BTreeSet<&str> = named.collect();
    assert!(named.len() >= 14, "{named:?}");
    assert_eq!(kinds, named);
}
