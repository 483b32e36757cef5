<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>AnswerHead</name>
    <message>
        <source>{0} at {1:g} Hz</source>
        <translation>{0}，{1:g} Hz</translation>
    </message>
    <message>
        <source>not determined: {0} of {1}</source>
        <translation>无法确定：{1} 个中的 {0} 个</translation>
    </message>
    <message>
        <source>{0} of {1} checks failed</source>
        <translation>{1} 项检验中 {0} 项不通过</translation>
    </message>
    <message>
        <source>Solved; the recording names no limits</source>
        <translation>已解算；数据未给出限差</translation>
    </message>
    <message>
        <source>Passed, {0} near-misses</source>
        <translation>通过，{0} 项临界</translation>
    </message>
    <message>
        <source>Inside every limit</source>
        <translation>全部在限差内</translation>
    </message>
</context>
<context>
    <name>AnswerTable</name>
    <message>
        <source>Parameters found</source>
        <extracomment>A difference of more than so many sigmas is marked.</extracomment>
        <translation>求得的参数</translation>
    </message>
    <message>
        <source>unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>found</source>
        <translation>求得</translation>
    </message>
    <message>
        <source>least squares</source>
        <translation>最小二乘</translation>
    </message>
    <message>
        <source>difference</source>
        <translation>差值</translation>
    </message>
    <message>
        <source>in σ</source>
        <translation>以 σ 计</translation>
    </message>
    <message>
        <source>before</source>
        <translation>标定前</translation>
    </message>
    <message>
        <source>bench&apos;s truth</source>
        <translation>虚拟台真值</translation>
    </message>
    <message>
        <source>error in σ</source>
        <translation>误差/σ</translation>
    </message>
    <message>
        <source>Not determined by this recording</source>
        <translation>这段数据无法确定</translation>
    </message>
</context>
<context>
    <name>AppliedController</name>
    <message>
        <source>Apply to a recording</source>
        <translation>应用于数据</translation>
    </message>
    <message>
        <source>Logs (*.h5 *.csv *.csv.gz)</source>
        <translation>数据 (*.h5 *.csv *.csv.gz)</translation>
    </message>
    <message>
        <source>All files (*)</source>
        <translation>所有文件 (*)</translation>
    </message>
</context>
<context>
    <name>AppliedView</name>
    <message>
        <source>Apply to a recording…</source>
        <translation>应用于数据…</translation>
    </message>
    <message>
        <source>Applying the answer</source>
        <translation>正在应用结果</translation>
    </message>
    <message>
        <source>This recording is of {0}; the answer was found for {1}.</source>
        <translation>这段数据属于 {0}，而结果是由 {1} 求得的。</translation>
    </message>
    <message>
        <source>| f | − g at rest, rms</source>
        <translation>静止时 | f | − g，均方根</translation>
    </message>
    <message>
        <source>Listening to the unit</source>
        <translation>正在接收产品数据</translation>
    </message>
    <message>
        <source>A calibration is going on; press STOP first.</source>
        <translation>标定正在进行，请先按停止。</translation>
    </message>
    <message>
        <source>The unit is being listened to.</source>
        <translation>正在接收产品的数据。</translation>
    </message>
    <message>
        <source>Takes {0} s of the unit&apos;s stream and shows them before and after; nothing moves, nothing is written</source>
        <translation>接收产品 {0} s 的实时数据，显示标定前后的对比；转台不动，也不写入任何内容</translation>
    </message>
    <message>
        <source>From the unit now</source>
        <translation>接收产品实时数据</translation>
    </message>
    <message>
        <source>Before and after, over time</source>
        <translation>标定前后随时间的对比</translation>
    </message>
    <message>
        <source>Listen to the unit, or choose any recording of it: what it says at rest is shown before and after.</source>
        <translation>接收产品的实时数据，或任选该产品的一段数据，显示其静止时标定前后的输出。</translation>
    </message>
    <message>
        <source>rate at rest, rms</source>
        <translation>静止时角速度，均方根</translation>
    </message>
    <message>
        <source>| f | − g, µg</source>
        <translation>| f | − g，µg</translation>
    </message>
    <message>
        <source>Rate, °/h</source>
        <translation>角速度，°/h</translation>
    </message>
    <message>
        <source>- - the earth&apos;s {0:.1f}</source>
        <translation>- - 地球 {0:.1f}</translation>
    </message>
    <message>
        <source>The unit that answers is {0}, the answer was found for {1}: put that unit into the fixture, or solve a recording of this one.</source>
        <translation>当前应答的产品是 {0}，而结果是由 {1} 求得的：请装上 {1}，或解算 {0} 的数据。</translation>
    </message>
    <message>
        <source>The unit&apos;s registers have corrected its stream already: it is shown as it comes, and the answer is not applied a second time.</source>
        <translation>产品已用其寄存器修正了输出数据：此处按原样显示，不再重复应用结果。</translation>
    </message>
    <message>
        <source>This unit cannot say its serial number; the answer was found for {0}.</source>
        <translation>该产品无法报告编号；结果是由 {0} 求得的。</translation>
    </message>
    <message>
        <source>Unit {0}, {1:.0f} s of its stream, taken at {2}</source>
        <translation>产品 {0}，实时数据 {1:.0f} s，接收于 {2}</translation>
    </message>
    <message>
        <source>before</source>
        <translation>标定前</translation>
    </message>
    <message>
        <source>after</source>
        <translation>标定后</translation>
    </message>
    <message>
        <source>as it comes</source>
        <translation>原样输出</translation>
    </message>
    <message>
        <source>shaded: rests, bold: their means; s from the start</source>
        <translation>阴影：静止段，粗线：其均值；横轴 s</translation>
    </message>
</context>
<context>
    <name>BenchBox</name>
    <message>
        <source>Virtual bench</source>
        <translation>虚拟台</translation>
    </message>
    <message>
        <source>MEMS grade</source>
        <translation>MEMS 级</translation>
    </message>
    <message>
        <source>tactical grade</source>
        <translation>战术级</translation>
    </message>
    <message>
        <source>navigation grade</source>
        <translation>导航级</translation>
    </message>
    <message>
        <source>unit</source>
        <translation>产品号</translation>
    </message>
    <message>
        <source>Another number draws another unit and other motions</source>
        <translation>换一个号就换一个产品和一组运动</translation>
    </message>
    <message>
        <source>Make one</source>
        <translation>生成数据</translation>
    </message>
    <message>
        <source>Makes a recording without hardware, with its truth beside it</source>
        <translation>无需硬件生成一段数据，真值存放在旁边</translation>
    </message>
</context>
<context>
    <name>GainBar</name>
    <message>
        <source>Gain {0}, stable below {1}, fastest at {2}</source>
        <extracomment>The bar reaches to so many times the largest stable gain, or the gain in use.</extracomment>
        <translation>增益 {0}，小于 {1} 稳定，{2} 时最快</translation>
    </message>
    <message>
        <source>α = {0}</source>
        <translation>α = {0}</translation>
    </message>
    <message>
        <source>fastest {0}</source>
        <translation>最快 {0}</translation>
    </message>
    <message>
        <source>stable below {0}</source>
        <translation>稳定上限 {0}</translation>
    </message>
</context>
<context>
    <name>GimbalView</name>
    <message>
        <source>Drift | D | in each turn, ″</source>
        <translation>每次转动的漂移 | D |，″</translation>
    </message>
    <message>
        <source>threshold</source>
        <translation>阈值</translation>
    </message>
    <message>
        <source>— predicted</source>
        <translation>— 预测</translation>
    </message>
    <message>
        <source>turn</source>
        <translation>次数</translation>
    </message>
</context>
<context>
    <name>Guidance</name>
    <message>
        <source>Needs</source>
        <translation>需要</translation>
    </message>
    <message>
        <source>Finds</source>
        <translation>得到</translation>
    </message>
</context>
<context>
    <name>MethodBar</name>
    <message>
        <source>Stages of the log</source>
        <translation>日志中的工序</translation>
    </message>
    <message>
        <source>Solve the stages again as they were recorded</source>
        <translation>按记录重新解算各工序</translation>
    </message>
</context>
<context>
    <name>MethodPanel</name>
    <message>
        <source>No recording was made</source>
        <extracomment>The tab that is always there.</extracomment>
        <translation>没有生成数据</translation>
    </message>
    <message>
        <source>This recording gives no answer</source>
        <translation>这段数据无法解算</translation>
    </message>
    <message>
        <source>The pair cannot be checked</source>
        <translation>无法检查</translation>
    </message>
    <message>
        <source>The export failed</source>
        <translation>导出失败</translation>
    </message>
    <message>
        <source>The answer cannot be applied</source>
        <translation>无法应用结果</translation>
    </message>
    <message>
        <source>Written</source>
        <translation>已写入</translation>
    </message>
    <message>
        <source>Wait for the work at hand, or cancel it</source>
        <translation>请等当前任务完成，或取消它</translation>
    </message>
    <message>
        <source>Open a recording first, or make one</source>
        <translation>请先打开或生成一段数据</translation>
    </message>
    <message>
        <source>Solve a recording first</source>
        <translation>请先解算一段数据</translation>
    </message>
    <message>
        <source>To the operator page, which guides from position to position</source>
        <translation>转到操作员页面，逐个位置引导</translation>
    </message>
    <message>
        <source>A calibration is going on; press STOP first.</source>
        <translation>标定正在进行，请先按停止。</translation>
    </message>
    <message>
        <source>This station&apos;s table is no hand rig. Choose a station with one on the Station page, for example &apos;{0}&apos;, which is software.</source>
        <translation>本工位没有手动工装。请在工位页面选择带手动工装的工位，例如软件模拟的“{0}”。</translation>
    </message>
    <message>
        <source>Solve</source>
        <translation>解算</translation>
    </message>
    <message>
        <source>Guide me live</source>
        <translation>现场引导</translation>
    </message>
    <message>
        <source>Export result…</source>
        <translation>导出结果…</translation>
    </message>
    <message>
        <source>How it is done</source>
        <translation>操作方法</translation>
    </message>
    <message>
        <source>Making a recording</source>
        <translation>正在生成数据</translation>
    </message>
    <message>
        <source>Following the recording</source>
        <translation>正在跟随数据</translation>
    </message>
    <message>
        <source>Reading the recording</source>
        <translation>正在读取数据</translation>
    </message>
    <message>
        <source>Solving</source>
        <translation>正在解算</translation>
    </message>
    <message>
        <source>Drawing</source>
        <translation>正在绘图</translation>
    </message>
    <message>
        <source>Writing the result</source>
        <translation>正在写结果</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
</context>
<context>
    <name>PairCheckView</name>
    <message>
        <source>Check at rest</source>
        <extracomment>What is left is drawn in °/s and m/s²: it is mostly that of motion.</extracomment>
        <translation>静止检查</translation>
    </message>
    <message>
        <source>Watch</source>
        <translation>监视</translation>
    </message>
    <message>
        <source>Kept</source>
        <translation>已保存</translation>
    </message>
    <message>
        <source>Check now</source>
        <translation>立即检查</translation>
    </message>
    <message>
        <source>Follows the recording as if it were live: what is off is calibrated and kept</source>
        <translation>像实时一样跟随数据：超差者标定并保存</translation>
    </message>
    <message>
        <source>Check now follows this recording as it would be followed live: a check at the first rest, and for what is off a calibration from the motion after it.</source>
        <translation>“立即检查”像实时一样跟随这段数据：在第一个静止段检查，超差者用其后的运动标定。</translation>
    </message>
    <message>
        <source>Given up: {0}</source>
        <translation>已放弃：{0}</translation>
    </message>
    <message>
        <source>IMU {0}</source>
        <translation>惯组 {0}</translation>
    </message>
    <message>
        <source>primary</source>
        <translation>主惯组</translation>
    </message>
    <message>
        <source>no rest to check at</source>
        <translation>没有静止段可检查</translation>
    </message>
    <message>
        <source>within</source>
        <translation>合格</translation>
    </message>
    <message>
        <source>off</source>
        <translation>超差</translation>
    </message>
    <message>
        <source>calibrated: now {0}</source>
        <translation>已标定，现为 {0}</translation>
    </message>
    <message>
        <source>calibrated, still {0}</source>
        <translation>已标定，仍为 {0}</translation>
    </message>
    <message>
        <source>at most {0}</source>
        <translation>上限 {0}</translation>
    </message>
    <message>
        <source>IMU {0}, {1}: nothing is kept of it yet.</source>
        <translation>惯组 {0}，{1}：尚未保存。</translation>
    </message>
    <message>
        <source>IMU {0}, {1}: calibrated last on {2}, {3} values in {4}</source>
        <translation>惯组 {0}，{1}：上次标定 {2}，{3} 个值存于 {4}</translation>
    </message>
</context>
<context>
    <name>PairLeftView</name>
    <message>
        <source>Secondary shown</source>
        <translation>所示从惯组</translation>
    </message>
    <message>
        <source>Nothing was calibrated in this recording</source>
        <translation>这段数据中没有标定</translation>
    </message>
    <message>
        <source>IMU {0}</source>
        <translation>惯组 {0}</translation>
    </message>
    <message>
        <source>{0} gyro against the primary, °/s</source>
        <translation>{0}陀螺与主惯组之差，°/s</translation>
    </message>
    <message>
        <source>{0} accelerometer against the primary, m/s²</source>
        <translation>{0}加表与主惯组之差，m/s²</translation>
    </message>
    <message>
        <source>gyro left, rms</source>
        <translation>陀螺残差，均方根</translation>
    </message>
    <message>
        <source>accelerometer left, rms</source>
        <translation>加表残差，均方根</translation>
    </message>
    <message>
        <source>clock offset</source>
        <translation>时钟偏差</translation>
    </message>
    <message>
        <source>lever arm x, y, z</source>
        <translation>杆臂 x、y、z</translation>
    </message>
    <message>
        <source>before</source>
        <translation>标定前</translation>
    </message>
    <message>
        <source>after</source>
        <translation>标定后</translation>
    </message>
    <message>
        <source>s from the start</source>
        <translation>横轴 s</translation>
    </message>
</context>
<context>
    <name>PositionsView</name>
    <message>
        <source>Directions of gravity in the unit&apos;s axes</source>
        <translation>重力在产品轴系中的方向</translation>
    </message>
    <message>
        <source>Where gravity lay in the unit at {0} rests. Drag to turn.</source>
        <translation>{0} 个静止段中重力在产品里的方向。拖动可旋转。</translation>
    </message>
    <message>
        <source>| f | − g at rest, rms</source>
        <translation>静止时 | f | − g，均方根</translation>
    </message>
    <message>
        <source>angle of motions, rms</source>
        <translation>运动角度误差，均方根</translation>
    </message>
    <message>
        <source>| f | − g at each rest, µg</source>
        <translation>各静止段 | f | − g，µg</translation>
    </message>
    <message>
        <source>Error of each motion&apos;s angle, ″</source>
        <translation>各段运动的角度误差，″</translation>
    </message>
    <message>
        <source>before</source>
        <translation>标定前</translation>
    </message>
    <message>
        <source>after</source>
        <translation>标定后</translation>
    </message>
    <message>
        <source>limit</source>
        <translation>限差</translation>
    </message>
</context>
<context>
    <name>_AxisPanel</name>
    <message>
        <source>Axis {0}: below the threshold</source>
        <extracomment>A promise smaller than this part of the smallest drift measured is not drawn.</extracomment>
        <translation>{0} 轴：已小于阈值</translation>
    </message>
    <message>
        <source>Axis {0}: not below the threshold</source>
        <translation>{0} 轴：未小于阈值</translation>
    </message>
    <message>
        <source>{0} turns by {1}°: {2} → {3}″, {4} % left by each</source>
        <translation>转 {0} 次，每次 {1}°：{2} → {3}″，每次剩 {4} %</translation>
    </message>
</context>
<context>
    <name>method_parts</name>
    <message>
        <source>outer rail</source>
        <extracomment>Colours of the files by the theme&apos;s names for them. Half of a picture&apos;s width, in its own units. Where each part is, in the same units from the centre, right and down. Share of a labelled picture&apos;s width that is kept for names on either side.</extracomment>
        <translation>外导轨</translation>
    </message>
    <message>
        <source>inner rail</source>
        <translation>内导轨</translation>
    </message>
    <message>
        <source>unit</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>joint z</source>
        <translation>框架 z</translation>
    </message>
    <message>
        <source>joint x</source>
        <translation>框架 x</translation>
    </message>
    <message>
        <source>joint y</source>
        <translation>框架 y</translation>
    </message>
    <message>
        <source>primary</source>
        <translation>主惯组</translation>
    </message>
    <message>
        <source>secondary</source>
        <translation>从惯组</translation>
    </message>
    <message>
        <source>lever arm</source>
        <translation>杆臂</translation>
    </message>
</context>
<context>
    <name>method_views</name>
    <message>
        <source>Rests and motions</source>
        <translation>静止与运动</translation>
    </message>
    <message>
        <source>Before and after</source>
        <translation>前后对比</translation>
    </message>
    <message>
        <source>Convergence</source>
        <translation>收敛过程</translation>
    </message>
    <message>
        <source>Check and watch</source>
        <translation>检查与监视</translation>
    </message>
    <message>
        <source>What is left</source>
        <translation>残差</translation>
    </message>
    <message>
        <source>Parameters</source>
        <translation>参数</translation>
    </message>
    <message>
        <source>Checks</source>
        <translation>检验</translation>
    </message>
</context>
<context>
    <name>methods</name>
    <message>
        <source>Multi-position</source>
        <extracomment>The methods by the names of their stages, in the page&apos;s order. The kind of recording (`station.bench_recordings.Kind`) that each of them solves.</extracomment>
        <translation>多位置</translation>
    </message>
    <message>
        <source>Gyros and accelerometers on a simple rig, or by hand</source>
        <translation>陀螺和加表，用简易工装或手持</translation>
    </message>
    <message>
        <source>Fix the unit to the inner rail, level, and let it rest for half a minute.</source>
        <translation>把产品水平固定在内导轨上，静止半分钟。</translation>
    </message>
    <message>
        <source>Carry it round on the inner rail and back. Let go at every position for some seconds; no angle has to be exact.</source>
        <translation>沿内导轨转一圈再转回来，每个位置松手停几秒，角度不必准确。</translation>
    </message>
    <message>
        <source>Do the same on the outer rail, and once more with the inner rail a quarter turn on.</source>
        <translation>沿外导轨同样做一遍；内导轨再转四分之一圈，外导轨重做一遍。</translation>
    </message>
    <message>
        <source>Rests and motions are found in the recording itself: at rest the force is as long as gravity, and a motion turns by as much as gravity&apos;s direction did.</source>
        <translation>静止段和运动段由数据自动识别：静止时比力的模等于重力，运动转过的角度等于重力方向的变化。</translation>
    </message>
    <message>
        <source>A recording of gyros and accelerometers with a dozen rests or more in well spread positions. No table, no angles.</source>
        <translation>陀螺和加表数据，十几个以上分布均匀的静止位置。不需要转台，也不需要角度。</translation>
    </message>
    <message>
        <source>Bias, scale factor and misalignment of gyros and accelerometers, each with its sigma.</source>
        <translation>陀螺和加表的零偏、刻度系数和安装误差，各带标准差。</translation>
    </message>
    <message>
        <source>Gimbal</source>
        <translation>框架</translation>
    </message>
    <message>
        <source>Gyro misalignment from the gimbal&apos;s own joints</source>
        <translation>由框架轴角求陀螺安装误差</translation>
    </message>
    <message>
        <source>Hold all joints at zero: what the gyros show there is their bias.</source>
        <translation>各框架锁在零位：此时陀螺的输出就是零偏。</translation>
    </message>
    <message>
        <source>Turn one axis by a set angle, while the gimbal stabilises the other two on the unit&apos;s corrected rates.</source>
        <translation>一个轴转过设定角度，另外两轴由框架按产品修正后的角速度稳定。</translation>
    </message>
    <message>
        <source>The other two joints drift by D, because the gyro axes are not square. D times the gain α corrects the matrix K.</source>
        <translation>陀螺轴不正交，另外两个框架会漂移 D；用 D 乘以增益 α 修正矩阵 K。</translation>
    </message>
    <message>
        <source>Back to zero, and again until D is below its threshold. Then the next axis.</source>
        <translation>回零再转，直到 D 小于阈值，然后换下一个轴。</translation>
    </message>
    <message>
        <source>A gimbal that stabilises on corrected rates, and a recording with its joint angles (joint_x_deg, joint_y_deg, joint_z_deg).</source>
        <translation>按修正后角速度稳定的框架，以及带框架角（joint_x_deg、joint_y_deg、joint_z_deg）的数据。</translation>
    </message>
    <message>
        <source>The six gyro misalignments; how fast each axis converged, the stable range of the gain, and the least-squares answer beside them.</source>
        <translation>六个陀螺安装误差；各轴收敛快慢、增益的稳定范围，并列出最小二乘解作对照。</translation>
    </message>
    <message>
        <source>Cross-calibration</source>
        <translation>互标定</translation>
    </message>
    <message>
        <source>A secondary IMU against the primary on the same body</source>
        <translation>同一载体上以主惯组标定从惯组</translation>
    </message>
    <message>
        <source>Fix all IMUs to one body and record them in the same rows.</source>
        <translation>把各惯组固定在同一载体上，按行同步录取。</translation>
    </message>
    <message>
        <source>Let the body rest. Every sensor is checked there against its threshold: the secondary&apos;s and the primary&apos;s own.</source>
        <translation>让载体静止，逐个检查从惯组和主惯组的每种传感器是否超过各自的阈值。</translation>
    </message>
    <message>
        <source>Where a secondary is off and the primary is not, turn and tilt the body about all axes until enough motion is collected.</source>
        <translation>从惯组超差而主惯组正常时，绕各轴转动、倾斜载体，直到采集到足够的运动。</translation>
    </message>
    <message>
        <source>The errors that are found replace those kept before. Later data are compensated with them, and then with the primary&apos;s own errors.</source>
        <translation>求得的误差替换原来保存的误差。以后的数据先用它补偿，再用主惯组自身的误差补偿。</translation>
    </message>
    <message>
        <source>Two IMUs or more, one row per sample (gyro2_x … accel2_z and [imu2]). The primary has been calibrated before.</source>
        <translation>两个以上惯组，每行一个采样（gyro2_x … accel2_z 和 [imu2]）。主惯组须已标定。</translation>
    </message>
    <message>
        <source>Bias and matrix of the secondary&apos;s gyros and accelerometers, its lever arm and its clock offset.</source>
        <translation>从惯组陀螺和加表的零偏与矩阵、杆臂和时钟偏差。</translation>
    </message>
</context>
<context>
    <name>pairs</name>
    <message>
        <source>gyro</source>
        <translation>陀螺</translation>
    </message>
    <message>
        <source>accelerometer</source>
        <translation>加表</translation>
    </message>
    <message>
        <source>waiting for a rest to check at</source>
        <translation>等待静止以便检查</translation>
    </message>
    <message>
        <source>waiting for motion about all axes</source>
        <translation>等待绕各轴的运动</translation>
    </message>
    <message>
        <source>waiting for motion: {0} % collected</source>
        <translation>等待运动：已采集 {0} %</translation>
    </message>
    <message>
        <source>following the recording</source>
        <translation>正在跟随数据</translation>
    </message>
    <message>
        <source>IMU {0}</source>
        <translation>惯组 {0}</translation>
    </message>
    <message>
        <source>triggered</source>
        <translation>触发</translation>
    </message>
    <message>
        <source>{0} checked</source>
        <translation>{0} 已检查</translation>
    </message>
    <message>
        <source>primary off itself</source>
        <translation>主惯组自身超差</translation>
    </message>
    <message>
        <source>off: waiting for motion</source>
        <translation>超差，等待运动</translation>
    </message>
    <message>
        <source>{0} calibrated</source>
        <translation>{0} 已标定</translation>
    </message>
    <message>
        <source>given up</source>
        <translation>已放弃</translation>
    </message>
    <message>
        <source>Checked by command</source>
        <translation>按命令检查</translation>
    </message>
    <message>
        <source>Checked at start-up</source>
        <translation>启动时检查</translation>
    </message>
    <message>
        <source>Checked at start-up and every {0} s</source>
        <translation>启动时及每 {0} s 检查一次</translation>
    </message>
    <message>
        <source>then all of a secondary that is off is calibrated</source>
        <translation>从惯组超差时其全部传感器都标定</translation>
    </message>
    <message>
        <source>then only the sensor that is off is calibrated</source>
        <translation>只标定超差的传感器</translation>
    </message>
    <message>
        <source>bias</source>
        <translation>零偏</translation>
    </message>
    <message>
        <source>bias and scale factors</source>
        <translation>零偏和刻度系数</translation>
    </message>
    <message>
        <source>bias and full matrix</source>
        <translation>零偏和完整矩阵</translation>
    </message>
    <message>
        <source>lever arm</source>
        <translation>杆臂</translation>
    </message>
    <message>
        <source>clock offset</source>
        <translation>时钟偏差</translation>
    </message>
    <message>
        <source>from {0} s of motion</source>
        <translation>采集运动 {0} s</translation>
    </message>
    <message>
        <source>{0} at a rest of {1} s; {2} ({3}), {4}.</source>
        <translation>{0}，要求静止 {1} s；{2}（{3}），{4}。</translation>
    </message>
    <message>
        <source>, </source>
        <translation>、</translation>
    </message>
    <message>
        <source>; </source>
        <translation>；</translation>
    </message>
    <message>
        <source>{0} {1} (primary {2})</source>
        <translation>{0} {1}（主惯组 {2}）</translation>
    </message>
    <message>
        <source>{0} Off is beyond: {1}.</source>
        <translation>{0}超差阈值：{1}。</translation>
    </message>
    <message>
        <source>what it showed after the last calibration + {0}, at first {1}</source>
        <translation>上次标定后的示值 + {0}，首次 {1}</translation>
    </message>
    <message>
        <source>{0} times what it showed after the last calibration, at first {1}</source>
        <translation>上次标定后示值的 {0} 倍，首次 {1}</translation>
    </message>
</context>
</TS>
