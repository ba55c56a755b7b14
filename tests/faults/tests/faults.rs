//! A little of each fault; `cargo xtask faults` does many. What this machine cannot do is skipped, and said.
#![cfg(unix)]

use myofield_faults::setting::Setting;
use myofield_faults::{Verdict, asked, disk, kills, leave, limit, second};
use myofield_tests::program;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// One test at a time: a process that another test starts while a program is being copied would hold the copy open, and it could not be run.
static ONE: Mutex<()> = Mutex::new(());

fn one_at_a_time() -> MutexGuard<'static, ()> {
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn setting() -> Setting {
    Setting::new(program()).unwrap()
}

#[track_caller]
fn held(verdict: Verdict) {
    match verdict {
        Verdict::Held(what) => println!("{what}"),
        Verdict::Skipped(reason) => println!("skipped: {reason}"),
    }
}

#[test]
fn a_training_killed_at_random_moments_ends_with_the_same_bytes() {
    let _one = one_at_a_time();
    let setting = setting();
    let kills = kills::kill_trainings(&setting, 8, 7, |_| ()).unwrap();
    assert_eq!(kills.count, 8);
    held(kills.verdict());
}

#[test]
fn a_question_to_a_run_that_is_killed_damages_nothing_and_is_answered_with_the_same_bytes() {
    let _one = one_at_a_time();
    held(asked::kill_questions(&setting(), 2, 7).unwrap());
}

#[test]
fn a_full_disk_loses_nothing_and_the_run_goes_on() {
    let _one = one_at_a_time();
    held(disk::fill_disks(&setting(), 3, 7).unwrap());
}

#[test]
fn a_limit_on_the_size_of_files_loses_nothing_and_the_run_goes_on() {
    let _one = one_at_a_time();
    held(limit::limit_files(&setting(), 3).unwrap());
}

#[test]
fn a_folder_that_becomes_read_only_loses_nothing_and_the_run_goes_on() {
    let _one = one_at_a_time();
    held(leave::take_leave(&setting(), 2, 7).unwrap());
}

#[test]
fn a_second_training_in_the_same_folder_is_refused_and_no_lock_outlives_its_process() {
    let _one = one_at_a_time();
    held(second::train_twice(&setting()).unwrap());
}
