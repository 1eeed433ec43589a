"""Estimating θ_s from throws of objects that tumble, in segments short enough for slopes.

From what is known of states where motion is chaotic (`chaotic_states`, `jumps`, `seen_points`) over
throws cut into segments (`segmented_throws`), the elimination of their states
(`segment_equations`) and how throws go on (`continuations`, `shooting`) to the fit
(`segmented_fit`).
"""
