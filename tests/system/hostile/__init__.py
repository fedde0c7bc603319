"""Hostile and unlucky files, and where each fault found has its tests (`test_list.py` looks; paths in `tests`).

Quietly wrong
 1. dropouts within the range: logs/test_log_dropouts.py::test_short_dropouts_within_the_range_are_found,
    logs/test_log_dropouts.py::test_readings_that_lie_about_are_found,
    test_signals.py::test_dropouts_within_the_range_are_left_out_and_counted,
    test_signals.py::test_dropouts_name_no_effect
 2. inputs written over: test_overwriting.py::test_an_input_is_never_written_over
 3. an empty name for a log: test_overwriting.py::test_an_empty_name_is_no_log
 4. one writer for all: test_overwriting.py::test_one_writer_keeps_links_modes_and_devices,
    test_overwriting.py::test_a_file_beside_is_never_more_readable_than_the_one_it_replaces,
    test_overwriting.py::test_a_pipe_receives_the_log, test_overwriting.py::test_a_pipe_is_written_once

Time and memory from a few bytes
 5. message types in message types, 6. lz4 chunks that lie: test_budgets.py::test_mcap
 7. npz of zeros: test_budgets.py::test_npz
 8. sparse HDF5: test_budgets.py::test_hdf5_of_sparse_width_and_many_datasets
 9. empty records, attachments, joint names of 100 kB: test_budgets.py::test_mcap;
    a line of commas: test_budgets.py::test_csv_of_one_line; endless input:
    test_budgets.py::test_standard_input_without_end;
    15,000 datasets: test_budgets.py::test_hdf5_of_sparse_width_and_many_datasets
10. joints without number: test_budgets.py::test_urdf, test_budgets.py::test_mjcf
11. numbers that no robot has, effects without number: test_budgets.py::test_robots_without_quantities;
    little address space: test_budgets.py::test_little_address_space, test_budgets.py::test_enough_address_space

Terminals, pages, pictures
12. texts from files: test_names.py::test_what_files_name_is_shown_with_its_controls_visible,
    test_names.py::test_names_of_saved_results_are_shown_with_their_controls_visible,
    report/test_visible.py::test_no_format_lets_a_control_through,
    report/test_visible.py::test_no_file_holds_a_control, report/test_visible.py::test_visible_texts
13. joints of any name in figures: test_names.py::test_joints_of_any_name_have_figures,
    report/test_visible.py::test_pictures_of_joints_with_any_name,
    report/test_visible.py::test_every_kind_of_figure_draws_a_dollar

Cluster
14. without workers: estimation/streaming/test_patience.py::test_no_worker_is_no_progress,
    estimation/streaming/test_cluster.py::test_a_scheduler_without_workers_is_given_up;
    a worker killed:
    estimation/streaming/test_cluster.py::test_a_cluster_gives_the_same_answer_though_a_worker_is_killed
15. addresses that are none: estimation/streaming/test_patience.py::test_an_address_that_is_none,
    estimation/streaming/test_cluster.py::test_a_port_where_nobody_listens_is_one_message
16. trust and certificates: estimation/streaming/test_cluster.py::test_an_encrypted_connection_needs_certificates,
    estimation/streaming/test_cluster.py::test_the_options_for_certificates_are_those_of_dask

Exit 70 and tracebacks
17. times in HDF5: test_budgets.py::test_hdf5_of_times; integers of 400 digits:
    test_budgets.py::test_saved_results_with_numbers_that_are_none; 60 dimensions: test_budgets.py::test_npz;
    tiny efforts: test_budgets.py::test_tiny_efforts_are_none; 1e300 and 1e-300 in robots, an axis of 1e200:
    test_budgets.py::test_robots_without_quantities, test_budgets.py::test_urdf
18. long names in errors: test_budgets.py::test_mcap, report/test_visible.py::test_visible_texts
19. lowest versions, Python 3.12 and 3.13: `.ci/lowest` and `PYTHON=python3.13 bash .ci/run` run the whole suite

Load
20. CSV in blocks: test_loads.py::test_a_csv_log_is_read_in_blocks; measured by
    `python -m tests.system.benchmarks.run --only csv`
21. many short logs: measured by `python -m tests.system.benchmarks.run --only short`
22. a long log against the truth: test_loads.py::test_the_numbers_of_a_long_log_are_the_truth; an hour by
    `python -m tests.system.reproduce.hours`
"""
