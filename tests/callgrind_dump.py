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

# With the file of each function; lines may be relative.
DUMP_WITH_LIBRARIES = """\
# callgrind format
version: 1
positions: line
events: Ir

ob=(1) ???
fn=(1) main
10 5
cob=(2) /lib/libmujoco.so
cfn=(2) mj_step
calls=2 20
* 90
ob=(2)
fn=(2)
20 60
+1 20
* 3
* 2
cob=(3) /lib/libc.so.6
cfn=(3) memcpy
calls=1 0
* 5
fn=(2)
0 1
ob=(3)
fn=(3)
0 5
ob=(2)
fn=(3)
0 4
"""
