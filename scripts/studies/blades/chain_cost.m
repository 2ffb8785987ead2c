% CPU time in s of the published code CC for a number of periods of a chain of ten sectors, printed as "cpu_s = NUMBER".
% Arguments: folder of CC, wave number, coupling, clearance over the linear amplitude, periods, start over the linear amplitude.
arguments = argv();
root = [arguments{1} '/'];
numbers = cellfun(@str2num, arguments(2:6));
addpath([root 'system'], [root 'integrator'], [root 'postprocessing'], [root 'simulations']);
run([root 'system/InitStructs.m']);
exc.k = numbers(1);
sys.kappa_c = numbers(2);
sys.Gamma_Scale = numbers(3);
[sys, exc] = BuildSystem(sys, exc, 'tuned');
exc.harmonic.r = sys.r_k(exc.k + 1);
rand('twister', 1);
sol = ConfigureIntegrator(sol, sys, exc, 'random', true, 'tuned');
places = sys.Phi * sol.q0;
larger = numbers(5) * sys.qref / max(abs(places));
sol.q0 = larger * sol.q0;
sol.qa0 = sol.qa0 + (larger - 1) * places;
sol.N_tau = 0;
sol.N_Save = 1;
sol.NP_trans = 5 * sol.N_P;
MoreauIntegration(sys, exc, sol, 'tuned');
sol.NP_trans = numbers(4) * sol.N_P;
began = cputime();
MoreauIntegration(sys, exc, sol, 'tuned');
printf('cpu_s = %.6f, steps = %d\n', cputime() - began, sol.N_P);
