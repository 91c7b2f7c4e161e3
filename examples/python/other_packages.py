"""Five tasks in other packages and in Rubato, each as a function of the package's name.

A function has the lines that a user writes, without imports, and returns the result. Run it to compare SciPy with Rubato.
"""

import numpy as np
import rubato as rb
from scipy.integrate import solve_ivp

try:
    import dedalus.public as d3
except ImportError:
    pass
try:
    import heyoka as hy
except ImportError:
    pass
try:
    import rebound
except ImportError:
    pass


class Pendulum:
    """A pendulum to t = 100."""

    tolerance = 1e-6

    def scipy():
        s = solve_ivp(lambda t, y: [y[1], -np.sin(y[0])], (0, 100), [0, 1.9], rtol=1e-10, atol=1e-10)
        return s.y[:, -1]

    def heyoka():
        q, p = hy.make_vars("q", "p")
        ta = hy.taylor_adaptive([(q, p), (p, -hy.sin(q))], [0.0, 1.9])
        ta.propagate_until(100.0)
        return ta.state

    def rubato():
        r = rb.integrate(rb.Hamiltonian("q", "p", "p^2/2 - cos(q)"), [0, 1.9], (0, 100), step=0.1)
        return r.sol(100)


class Planet:
    """A planet of eccentricity 0.6 to t = 100."""

    tolerance = 1e-6

    def rebound():
        sim = rebound.Simulation()
        sim.add(m=1)
        sim.add(a=1, e=0.6)
        sim.integrator, sim.dt = "whfast", 0.01
        sim.integrate(100)
        return [*sim.particles[1].xyz[:2], *sim.particles[1].vxyz[:2]]

    def scipy():
        def gravity(t, z):
            return [z[2], z[3], *(-z[:2]/np.hypot(z[0], z[1])**3)]
        s = solve_ivp(gravity, (0, 100), [0.4, 0, 0, 2], rtol=1e-12, atol=1e-12, method="DOP853")
        return s.y[:, -1]

    def rubato():
        kepler = rb.Hamiltonian("r[2]", "v[2]", lambda r, v: v @ v/2 - 1/np.sqrt(r @ r))
        r = rb.integrate(kepler, [0.4, 0, 0, 2], (0, 100), step=0.01)
        return r.sol(100)


class Apocentre:
    """Its first apocentre, and the way there: the state at t = 2.5."""

    tolerance = 1e-7

    def heyoka():
        x, y, u, v = hy.make_vars("x", "y", "u", "v")
        a = -(x**2 + y**2)**-1.5
        apsis = hy.t_event(x*u + y*v, direction=hy.event_direction.negative)
        ta = hy.taylor_adaptive([(x, u), (y, v), (u, a*x), (v, a*y)], [0.4, 0.0, 0.0, 2.0], t_events=[apsis])
        way = ta.propagate_until(100.0, c_output=True)[4]
        return way(2.5)

    def scipy():
        def gravity(t, z):
            return [z[2], z[3], *(-z[:2]/np.hypot(z[0], z[1])**3)]
        def apsis(t, z):
            return np.dot(z[:2], z[2:])
        apsis.terminal, apsis.direction = True, -1
        s = solve_ivp(gravity, (0, 100), [0.4, 0, 0, 2], rtol=1e-10, atol=1e-10, events=apsis, dense_output=True)
        return s.sol(2.5)

    def rubato():
        kepler = rb.Hamiltonian("r[2]", "v[2]", lambda r, v: v @ v/2 - 1/np.sqrt(r @ r))
        apsis = rb.Event(lambda r, v: r @ v, direction=-1, terminal=True)
        r = rb.integrate(kepler, [0.4, 0, 0, 2], (0, 100), step=0.01, events=apsis)
        return r.sol(2.5)


class HundredPendulums:
    """A hundred pendulums to t = 50."""

    tolerance = 1e-5

    def heyoka():
        q, p = hy.make_vars("q", "p")
        one = hy.taylor_adaptive([(q, p), (p, -hy.sin(q))], [0.0, 0.1])
        def start(ta, i):
            ta.state[:] = [0.0, 0.1 + 0.018*i]
            return ta
        runs = hy.ensemble_propagate_until(one, 50.0, 100, start)
        return np.array([run[0].state for run in runs])

    def scipy():
        runs = [solve_ivp(lambda t, y: [y[1], -np.sin(y[0])], (0, 50), [0, 0.1 + 0.018*i], rtol=1e-9, atol=1e-9)
                for i in range(100)]
        s = np.array([run.y[:, -1] for run in runs])
        return s

    def rubato():
        pendulum = rb.Hamiltonian("q", "p", "p^2/2 - cos(q)")
        many = rb.integrate(pendulum, [[0, 0.1 + 0.018*i] for i in range(100)], (0, 50), step=0.1, t_eval=[50])
        return many.y[:, :, 0]


class Wave:
    """A wave of the sine-Gordon equation to t = 20."""

    tolerance = 0.01

    def dedalus():
        x_axis = d3.Coordinate("x")
        dist = d3.Distributor(x_axis, dtype=np.float64)
        basis = d3.RealFourier(x_axis, size=400, bounds=(-20, 20), dealias=3/2)
        u, v = dist.Field(name="u", bases=basis), dist.Field(name="v", bases=basis)
        v["g"] = 2/np.cosh(dist.local_grid(basis))
        problem = d3.IVP([u, v], namespace=locals())
        problem.add_equation("dt(u) - v = 0")
        problem.add_equation("dt(v) - lap(u) = -sin(u)")
        solver = problem.build_solver(d3.RK443)
        solver.stop_sim_time = 20
        while solver.proceed:
            solver.step(0.05)
        return u["g"]

    def scipy():
        x = -20 + 40/401*np.arange(401)
        k = 2*np.pi*np.fft.rfftfreq(401, 40/401)
        def equation(t, z):
            return np.concatenate([z[401:], np.fft.irfft(-k**2*np.fft.rfft(z[:401]), 401) - np.sin(z[:401])])
        s = solve_ivp(equation, (0, 20), np.concatenate([0*x, 2/np.cosh(x)]), rtol=1e-8, atol=1e-8)
        return s.y[:401, -1]

    def rubato():
        line = rb.Lattice(rb.Field(equation="u_tt = u_xx - sin(u)"), {"x": (-20, 20, 401)}, {"u": 0, "u_t": "2*sech(x)"})
        r = rb.integrate(line, (0, 20), step=0.05, scheme="fourier", t_eval=[20])
        return r.u[-1]


TASKS = [Pendulum, Planet, Apocentre, HundredPendulums, Wave]

if __name__ == "__main__":
    for task in TASKS:
        print(f"{task.__name__:<20}difference of SciPy and Rubato {np.abs(task.scipy() - task.rubato()).max():.1e}")
