"""Controller periods in a row as one function to compile: motor-side PD control, exact springs, what is noted.

It is what `closed_loop` does period by period in Python, where torques are held and nothing but the robot moves. It
stops where something is missing that Python has to make, and goes on from there.
"""

from __future__ import annotations

DONE, TURNED, STUCK = 0, -1, -2
"""Why it stopped: nothing is left; a mass matrix is needed at the present position; the motion gets no further. A
positive number asks for the step's matrices with so many steps per period."""

_SOURCE = """
def periods(begin, end, moving, x, wanted, law, motors, bounds, about, fine, known, linear, matrices, noted):
 theta, speed, feed = wanted
 kp, kd, limits = law
 period, turn, zone, runaway, coarse = bounds
 first, second, third, last = matrices
 states, rates, commands = noted
 tau, start = np.empty(JOINTS), np.empty(HALF)
 for k in range(begin, end):
  for j in range(JOINTS):
   at = motors[j]
   asked = feed[k, j] + kp[j] * (theta[k, j] - x[at]) + kd[j] * (speed[k, j] - x[HALF + at])
   tau[j] = min(max(asked, -limits[j]), limits[j])
   commands[k, j] = tau[j]
  found = accelerations(ARGUMENTS)
  for i in range(HALF):
   start[i] = found[i]
   rates[k, i] = found[i]
   if not abs(start[i]) < 1e999:
    return k, STUCK
  states[k] = x
  if k >= moving:
   break
  needed = coarse
  for j in range(JOINTS):
   if not abs(x[j] - about[j]) <= turn:
    return k, TURNED
   now = x[HALF + motors[j]]
   later = now + period * start[motors[j]]
   if (now * later <= 0 or min(abs(now), abs(later)) < zone[j]) and fine[j] > needed:
    needed = fine[j]
  level = 0
  while (coarse << level) < needed:
   level += 1
  if not known[level]:
   return k, needed
  y = through(x, tau, start, linear, first[level], second[level], third[level], last[level], needed)
  for i in range(2 * HALF):
   if not abs(y[i]) < (runaway if i < JOINTS else 1e999):
    return k, STUCK
  x[:] = y
 return end, DONE
"""


def periods_source(half: int, n: int) -> str:
    """Return the function's text for n joints and `half` positions; it calls `accelerations` and `through`.

    Arguments are the periods `begin` to `end`, of which those below `moving` are also integrated; the state x, which
    is moved on; `wanted`, (θ, θ', feed-forward torque) of every period, each of shape (N, n); `law`, (kp, kd, limits);
    the motors' places in x; `bounds`, (period in s, rad that a mass matrix serves, zones of friction, positions that
    are too far, least number of steps); the linear part, its position, the steps that each motor's friction needs, and
    which matrices of the step are `known`; `noted`, (states, accelerations, commands) to be written. It returns the
    period that it came to and why it stopped.
    """
    arguments = ", ".join([*(f"x[{i}]" for i in range(2 * half)), *(f"tau[{k}]" for k in range(n))])
    text = _SOURCE.strip().replace("ARGUMENTS", arguments)
    for name, value in (("JOINTS", n), ("HALF", half), ("DONE", DONE), ("TURNED", TURNED), ("STUCK", STUCK)):
        text = text.replace(name, str(value))
    return text
