"""A dump in Callgrind's format: main calls mj_step twice, and that the rest of the pipeline."""

DUMP = """\
# callgrind format
version: 1
positions: line
events: Ir

fn=(1) main
10 5
cfn=(2) mj_step
calls=2 20
11 1000
fn=(2)
20 100
+1 50
cfn=(3) mj_forward
calls=2 30
* 850
fn=(3)
30 50
cfn=(4) mj_collision
calls=2 40
31 500
cfn=(5) mj_solNewton.isra.0
calls=2 50
32 300
fn=(4)
40 500
fn=(5)
50 300
"""
